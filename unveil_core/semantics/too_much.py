"""Whether more goes than anybody would want gone: masks the other way round, labels that mean something else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.check import Checked
from unveil_core.drives.labels.mask_codes import TURNED_ROUND
from unveil_core.semantics.classes import REMOVABLE, expand_names

__all__ = ["MUCH", "much_removed"]

MUCH = 0.5
"""Share of a picture beyond which its removal is doubted; traffic at its densest has a third."""


def much_removed(
    drive: Drive, checked: Checked, remove: Sequence[str] = (), instances: Sequence[int] = ()
) -> Finding | None:
    """That more than half of most frames is to be removed.

    Args:
        drive: as read; checked: what was seen of its labels.
        remove: class names and groups as typed; instances: ids of single objects. Where only these are given no share is known.
    Raises:
        SelectionError: an unknown name.
    """
    if instances and not remove:
        return None
    total = checked.classes.sum(axis=1)
    if total.any():
        present = checked.classes[:, : len(CITYSCAPES)].sum(axis=0) > 0
        names = [n for n in (expand_names(remove) if remove else REMOVABLE) if present[CITYSCAPES.index(n)]]
        chosen = checked.classes[:, [CITYSCAPES.index(n) for n in names]].sum(axis=1)
        shares = chosen[total > 0] / total[total > 0]
        what = f"what is to be removed ({', '.join(names)}) has"
        mend = "--remove chooses other classes, --label-classes says what the labels hold"
    else:
        shares = checked.masked[np.isfinite(checked.masked)]
        what = "masks remove"
        mend = TURNED_ROUND[drive.frames[0].codes.mask.removes]
    much = shares[shares > MUCH]
    if not len(shares) or 2 * len(much) <= len(shares):
        return None
    low, high = f"{100 * much.min():.0f}", f"{100 * much.max():.0f}"
    share = f"{high} %" if low == high else f"{low} to {high} %"
    return Finding(f"{what} {share} of {len(much)} of {len(shares)} frames", mend, asks=True)
