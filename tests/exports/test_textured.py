"""Meshes with textures through the verb, read back by other libraries; how textures are painted is tested with them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.exports.conftest import Street
from tests.exports.street import WORLD
from unveil_core.app.cli import main

pytest.importorskip("xatlas")
BACK = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From y up to z up."""


def levels(folder: Path) -> list[dict]:
    told = json.loads((folder / "export.json").read_text())
    assert told["coordinates"]["metres_per_unit"] == pytest.approx(1 / WORLD.scale)
    # Nothing is left out of the coordinates: a node, a transform or text holds them whole.
    assert told["coordinates"]["shift"] == [0, 0, 0] and told["format"].startswith("textured-")
    return told["levels"]


def triangles_in_world(street: Street) -> np.ndarray:
    """(F, 3, 3) corners, sorted, so that the order of triangles does not count."""
    mesh = street.job.mesh
    return ordered(WORLD.to_world(mesh.vertices)[mesh.faces])


def ordered(corners: np.ndarray) -> np.ndarray:
    centres = np.round(corners.mean(axis=1), 3)
    return centres[np.lexsort(centres.T)]


def test_trimesh_reads_the_glb_with_its_picture(street: Street) -> None:
    folder = street.exported("textured-glb")
    (level,) = levels(folder)
    scene = trimesh.load(folder / level["file"], process=False)
    mesh = scene.to_mesh()
    assert len(mesh.faces) == level["triangles"] == len(street.job.mesh.faces)
    expected = WORLD.scale * street.job.mesh.vertices + WORLD.directions_to_local(WORLD.translation)
    ours = ordered(expected[street.job.mesh.faces])
    np.testing.assert_allclose(ordered((np.array(mesh.vertices) @ BACK.T)[mesh.faces]), ours, atol=2e-3)
    for geometry in scene.geometry.values():
        picture = geometry.visual.material.baseColorTexture
        assert list(picture.size) in level["pages"] and geometry.visual.uv.shape == (len(geometry.vertices), 2)
        assert geometry.visual.uv.min() >= 0 and geometry.visual.uv.max() <= 1


def test_pygltflib_finds_unlit_materials_with_pictures_in_the_file(street: Street) -> None:
    pygltflib = pytest.importorskip("pygltflib")
    folder = street.exported("textured-glb")
    document = pygltflib.GLTF2().load(str(folder / "empty.glb"))
    assert document.materials and all("KHR_materials_unlit" in m.extensions for m in document.materials)
    assert [i.mimeType for i in document.images] == ["image/jpeg"] * len(document.materials)
    blob = document.binary_blob()
    for image in document.images:
        view = document.bufferViews[image.bufferView]
        assert blob[view.byteOffset : view.byteOffset + 3] == b"\xff\xd8\xff" and view.byteOffset % 4 == 0


def test_trimesh_reads_the_obj_with_its_pictures(street: Street) -> None:
    folder = street.exported("textured-obj")
    (level,) = levels(folder)
    mesh = trimesh.load(folder / level["file"], process=False, force="mesh")
    np.testing.assert_allclose(ordered(np.array(mesh.vertices)[mesh.faces]), triangles_in_world(street), atol=2e-3)
    picture = mesh.visual.material.image
    assert picture is not None and list(picture.size) in level["pages"]


def test_usd_core_reads_the_stage_with_its_pictures(street: Street) -> None:
    usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom, UsdShade

    folder = street.exported("textured-usd")
    (level,) = levels(folder)
    stage = usd.Stage.Open(str(folder / level["file"]))
    count = 0
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        count += len(mesh.GetFaceVertexCountsAttr().Get())
        st = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st").Get()
        assert len(st) == len(mesh.GetPointsAttr().Get())
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        shader = UsdShade.Shader.Get(stage, material.GetPath().AppendChild("texture"))
        assert Path(shader.GetInput("file").Get().resolvedPath).is_file()
    assert count == level["triangles"]


def test_levels_of_detail_have_a_quarter_each(street: Street, tmp_path: Path) -> None:
    command = ["export", str(street.root), "--to", "textured-glb", "--lods", "2", "--texture", "512", "-o"]
    assert main([*command, str(tmp_path)]) == 0
    told = levels(tmp_path / "textured_glb")
    assert [level["file"] for level in told] == ["empty.glb", "empty_lod1.glb", "empty_lod2.glb"]
    count = len(street.job.mesh.faces)
    for number, level in enumerate(told):
        assert level["triangles"] <= max(count >> 2 * number, 4)
        assert all(max(page) <= 512 >> number for page in level["pages"])


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--lods", "9"], "--lods 9"),
        (["--texture", "10"], "--texture 10"),
        (["--texture", "256", "--lods", "5"], "fewer"),
    ],
)
def test_what_makes_no_texture_is_one_line(
    options: list[str], line: str, street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(street.root), "--to", "textured-glb", *options, "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1 and not (tmp_path / "out").exists()
