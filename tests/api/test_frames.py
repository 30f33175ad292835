"""Frames as arrays: of one size and lens each, read when they are asked for."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import unveil_core as unveil
from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image_as_it_is, read_label_image
from unveil_core.workspace.files import save_mask


def test_at_the_size_of_the_footage(finished: Path) -> None:
    space = unveil.Workspace.open(finished)
    assert space.cameras == ("front",)
    frames = space.frames("front")
    assert [f.name for f in frames] == ["0000", "0001", "0002"] and frames[1].timestamp == 100.1
    frame = frames[0]
    photo, clean = frame.photo(), frame.clean()
    assert photo.shape == clean.shape == (96, 128, 3) and photo.dtype == np.uint16
    assert np.array_equal(clean, read_image_as_it_is(finished / "frames/front/0000.png"))
    assert (frame.camera.width, frame.camera.height) == (128, 96) and frame.distortion is not None
    depth, provenance = frame.depth("full"), frame.provenance()
    masks = [frame.mask(kind) for kind in ("removed", "shadows", "changed", "unobserved")]  # type: ignore[arg-type]
    for plane in (depth, provenance, frame.certainty(), frame.labels(), frame.instances(), *masks):
        assert plane.shape == (96, 128)
    removed, shadows, changed, _ = masks
    assert removed.dtype == bool and removed.any() and np.array_equal(changed, removed | shadows)
    assert depth.dtype == np.float32 and set(np.unique(provenance)) <= set(range(5))


def test_grey_footage_has_a_channel(finished: Path, tmp_path: Path) -> None:
    """What is asked of the pixels along the last axis is asked of pixels, not of rows."""
    root = shutil.copytree(finished, tmp_path / "w")
    grey = np.arange(96 * 128, dtype=np.uint16).reshape(96, 128)
    changed = np.where(np.indices(grey.shape)[1] < 32, 60_000, grey).astype(np.uint16)
    for folder, picture in (("drive/footage", grey), ("frames", changed)):
        write_image_atomic(root / folder / "front/0000.png", picture)
    frame = unveil.Workspace.open(root).frames()[0]
    photo, clean = frame.photo(), frame.clean()
    assert photo.shape == clean.shape == (96, 128, 1) and np.array_equal(photo[..., 0], grey)
    assert (photo == clean).all(axis=-1).mean() == 0.75


def test_at_working_size_without_a_lens(finished: Path) -> None:
    frame = unveil.Workspace.open(finished).frames(size="work")[0]
    assert frame.distortion is None and frame.camera.width == 64
    own = read_label_image(finished / "provenance/front/0000.png")
    assert np.array_equal(frame.provenance(), own) and frame.photo().shape == (48, 64, 3)
    assert np.array_equal(frame.mask(), read_label_image(finished / "masks/removed/front/0000.png") > 127)
    assert np.array_equal(frame.labels() == 13, frame.instances() > 0)


def test_the_lens_moves_what_working_pictures_show(finished: Path, tmp_path: Path) -> None:
    """The middle stays and the border is drawn in: a mask at footage size lies where the footage shows it."""
    space = unveil.Workspace.open(shutil.copytree(finished, tmp_path / "w"))
    rows, columns = np.indices((48, 64))
    save_mask((rows // 4 + columns // 4) % 2 == 0, tmp_path / "w/masks/removed/front/0000.png")
    small, large = (space.frames(size=s)[0].mask() for s in ("work", "footage"))  # type: ignore[arg-type]
    same = small.repeat(2, axis=0).repeat(2, axis=1) == large
    assert same[36:60, 48:80].mean() > 0.95 and same[:12, :16].mean() < 0.9


def test_what_is_missing_is_one_line_with_the_mend(finished: Path, street: Path, tmp_path: Path) -> None:
    space = unveil.run(street, tmp_path / "w", until="import")
    frame = space.frames()[0]
    assert frame.photo().shape == (24, 32, 3)
    for ask, stage in ((frame.clean, "deliver"), (frame.mask, "remove"), (frame.provenance, "reoptimize")):
        with pytest.raises(WorkspaceError, match=f"run `unveil {stage}`"):
            ask()
    with pytest.raises(WorkspaceError, match="Not made yet: the empty scene"):
        frame.depth()
    with pytest.raises(SettingsError, match="Not a mask: 'cars'.*removed"):
        frame.mask("cars")  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="Not a camera: 'rear'"):
        space.frames("rear")
    with pytest.raises(SettingsError, match="Not a size"):
        space.frames(size="large")  # type: ignore[arg-type]
    with pytest.raises(unveil.UnveilError):
        unveil.Workspace.open(tmp_path / "nowhere")
