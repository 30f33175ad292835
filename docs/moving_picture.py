"""Makes the moving picture of the README: a drive as it was photographed on the left, as it was delivered on the right.

    python docs/moving_picture.py WORKSPACE [-o docs/pictures/street.webp] [--camera NAME]

The workspace is that of ``unveil demo``. The picture is an animated WebP, of the highest quality that keeps it within
:data:`MOST_BYTES`.
"""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from unveil_core import UnveilError, Workspace  # noqa: E402

MOST_BYTES = 700_000
"""A page with it still opens at once, and the repository stays small."""
FRAME_MS = 160
"""How long a frame is shown. The sample's frames are 1.15 m apart, so this is 26 km/h."""
GAP_PX = 8
QUALITIES = (85, 80, 75, 70, 65, 60, 50, 40)


def side_by_side(photo: NDArray[np.uint8], clean: NDArray[np.uint8]) -> Image.Image:
    """Two pictures (H, W, 3) with a white gap between them, (H, 2 W + gap)."""
    gap = np.full((len(photo), GAP_PX, 3), 255, np.uint8)
    return Image.fromarray(np.hstack([photo, gap, clean]))


def animation(pictures: list[Image.Image], most_bytes: int = MOST_BYTES) -> bytes:
    """An endless animated WebP in the highest quality that fits.

    Raises:
        SystemExit: none fits.
    """
    for quality in QUALITIES:
        file = io.BytesIO()
        pictures[0].save(
            file,
            "WEBP",
            save_all=True,
            append_images=pictures[1:],
            duration=FRAME_MS,
            loop=0,
            quality=quality,
            method=6,
        )
        if file.tell() <= most_bytes:
            return file.getvalue()
    raise SystemExit(f"More than {most_bytes:,} bytes even at quality {QUALITIES[-1]}. Give fewer or smaller frames.")


def main() -> None:
    """Write the picture of a workspace."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("workspace", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "pictures" / "street.webp")
    parser.add_argument("--camera", help="of a rig; the only one without it")
    options = parser.parse_args()
    try:
        frames = Workspace.open(options.workspace).frames(options.camera)
        pictures = [side_by_side(frame.photo(), frame.clean()) for frame in frames]
    except UnveilError as error:
        raise SystemExit(str(error)) from None
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_bytes(animation(pictures))
    print(f"{options.output}: {len(pictures)} frames, {options.output.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
