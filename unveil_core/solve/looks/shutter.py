"""How far a rolling shutter bends frames: rows are read one after the other, and meanwhile the picture moves on."""

from __future__ import annotations

import numpy as np

from unveil_core.solve.looks.motion import Motion
from unveil_core.solve.looks.thumbs import FLOW_PX, Thumbs

__all__ = ["told_of_shutter"]

READOUT_S = 0.02
"""From the first row to the last: phones take 0.01 to 0.03 s, most action and mirrorless cameras likewise."""
BENT = 0.0075
"""Share of the longer side by which frames are bent that a solve no longer explains: 7 pixels of 960."""
FEWEST = 2
"""One frame is a bump, which the others outvote."""
LONGEST_STEP_S = 0.5
"""Between frames farther apart than this nobody knows how fast the camera moved."""


def told_of_shutter(thumbs: Thumbs, motion: Motion) -> str | None:
    """What a user should know where the picture moves fast; None where it does not, or frames have no times.

    Args:
        thumbs: of one camera's N frames; motion: between them.
    """
    times = np.array([np.nan if f.time_s is None else f.time_s for f in thumbs.frames])
    apart = np.diff(times)
    timed = (apart > 0) & (apart <= LONGEST_STEP_S)
    bent = np.zeros(len(apart))
    bent[timed] = motion.step[timed] / FLOW_PX * READOUT_S / apart[timed]
    fast = np.flatnonzero(bent > BENT)
    if len(fast) < FEWEST:
        return None
    first, last = (thumbs.frames[k].number for k in (fast[0], fast[-1] + 1))
    return (
        f"the picture moves fast in {len(fast)} steps between the frames {first} and {last}: a rolling shutter, which "
        f"phones and most cameras have, bends it by up to {100 * bent.max():.1f} % of its width; turn more slowly, use a "
        "gimbal, or leave that part out"
    )
