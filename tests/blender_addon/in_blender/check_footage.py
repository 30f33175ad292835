"""Footage that is larger than the scene's working size, or has a lens: cameras, plates and strips fit what is delivered."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from conftest import outside


@pytest.fixture(params=[False, True], ids=["pinhole", "lens"])
def reduced(request: pytest.FixtureRequest, addon, street: Path, finished: Path, tmp_path: Path) -> tuple[Path, bool]:  # type: ignore[no-untyped-def]
    """The finished workspace of 128x80, its drive imported again at 64 pixels; and whether the footage has a lens."""
    folder = tmp_path / "street"
    shutil.copytree(street.parent, folder)
    document = json.loads((folder / "transforms.json").read_text())
    if request.param:
        document["camera_model"], document["k1"] = "OPENCV", -0.05
    (folder / "transforms.json").write_text(json.dumps(document))
    shutil.copytree(finished, tmp_path / "ws")
    outside("-m", "unveil_core", "import", str(folder), "-o", str(tmp_path / "ws"), "--work-side", "64", "--replace")
    return tmp_path / "ws", request.param


def size_of(path: Path) -> tuple[int, int]:
    import bpy

    image = bpy.data.images.load(str(path), check_existing=False)
    found = tuple(image.size)
    bpy.data.images.remove(image)
    return found  # type: ignore[return-value]


def test_what_is_delivered_fits(addon, scene, reduced: tuple[Path, bool]) -> None:
    import bpy

    workspace, in_lens = reduced
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    plates, versions = addon.module("scene.images.plates"), addon.module("scene.versions")
    camera = scene.camera
    entry = json.loads((workspace / "drive/cameras.json").read_text())["frames"][0]
    shown = entry if in_lens else entry["footage"]
    size = (shown["width"], shown["height"])
    assert size == ((64, 40) if in_lens else (128, 80))
    assert (scene.render.resolution_x, scene.render.resolution_y) == size == tuple(camera["unveil_size"])
    assert camera.data.lens == pytest.approx(36 * shown["fx"] / shown["width"])
    # Behind a camera without a lens lie pictures without one, at the size of the footage where it has none either.
    assert size_of(Path(plates.files_of(camera, "original")[0])) == size
    folder = "clean" if in_lens else "frames"
    (clean,) = {Path(f).parent for f in plates.files_of(camera, "clean")}
    assert clean == workspace / folder / "camera"
    assert all(b.frame_method == "STRETCH" for b in camera.data.background_images)
    # Strips are the footage and what replaces it, in one lens and size.
    strips = {s.name: [Path(f) for f in versions.strip_files(s)] for s in versions.strips_of(scene)}
    assert set(strips) == {"camera original", "camera clean"}
    for name, own in (("original", "drive/footage"), ("clean", "frames")):
        files = sorted((workspace / own / "camera").iterdir())
        assert [f.read_bytes() for f in strips[f"camera {name}"]] == [f.read_bytes() for f in files] and len(files) == 8
    bpy.ops.unveil.load_workspace()
    assert len(versions.strips_of(scene)) == 2
