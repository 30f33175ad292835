"""A choice that selects nothing says why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import SelectionError
from unveil_core.base.files import write_image_atomic
from unveil_core.drives import open_drive
from unveil_core.semantics.labels import choose_labels


def masked(folder: Path, level: int) -> Path:
    """A drive whose masks have one level."""
    drive = make_tiny_drive(folder, semantics=False)
    write_image_atomic(folder / "mask.png", np.full((24, 32), level, np.uint8))
    edit(drive, lambda d: [f.update(mask_path="mask.png") for f in d["frames"]])
    return drive


@pytest.mark.parametrize(("level", "removes", "mend"), [(255, None, "white turns"), (0, "white", "black turns")])
def test_masks_that_remove_nothing_name_the_other_way(
    level: int, removes: str | None, mend: str, tmp_path: Path
) -> None:
    drive = masked(tmp_path, level)
    with pytest.raises(SelectionError, match=rf"no mask has anything {removes or 'black'}.*{mend}"):
        choose_labels(open_drive(drive, DriveOptions(mask_removes=removes)))
    other = DriveOptions(mask_removes=None if removes else "white")
    assert choose_labels(open_drive(drive, other)).removed == ("remove",)
