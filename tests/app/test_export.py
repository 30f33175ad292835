"""``unveil export``: the same street in every format, where the drive says it is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.evaluate.street_workspace import OFFSET, build_workspace
from tests.mesh.test_tsdf import street_views
from unveil_core.app.cli import main
from unveil_core.base.output.stamps import stamp_of
from unveil_core.base.output.written import GENERATOR
from unveil_core.drives.imported import read_imported
from unveil_core.mesh import Mesh, fuse, write_glb, write_ply


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    workspace = build_workspace(tmp_path_factory.mktemp("street"), count=2, truth=False)
    drive = read_imported(workspace / "drive")
    mesh = fuse(street_views(2), voxel_size=0.15, max_depth=12.0)
    write_ply(mesh, workspace / "meshes/full.ply", drive.to_world)
    less = Mesh(mesh.vertices, mesh.faces[: len(mesh.faces) // 2], mesh.colors)
    write_ply(less, workspace / "meshes/empty.ply", drive.to_world)
    write_glb(less, workspace / "meshes/empty.glb", drive.to_world)
    return workspace


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished, tmp_path / "workspace")
    return tmp_path / "workspace"


def opened(path: Path) -> trimesh.Trimesh:
    loaded = trimesh.load(path, process=False)
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_mesh()
        loaded.apply_transform([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # y up to z up
    return loaded


@pytest.mark.parametrize("kind", ["ply", "obj", "glb"])
def test_every_format_holds_the_mesh_in_the_world(
    kind: str, workspace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(workspace), "--to", kind, "--state", "full"]) == 0
    path = workspace / f"meshes/full_all.{kind}"
    assert capsys.readouterr().out == f"{path}\n"
    ours, theirs = opened(workspace / "meshes/full.ply"), opened(path)
    np.testing.assert_allclose(theirs.vertices, ours.vertices, atol=1e-5)
    np.testing.assert_array_equal(theirs.faces, ours.faces)
    assert np.abs(ours.vertices[:, :2] - OFFSET[:2]).max() < 100
    if kind != "glb":  # which has linear colours, see the tests of write_glb
        np.testing.assert_array_equal(theirs.visual.vertex_colors, ours.visual.vertex_colors)


def test_fewer_triangles_and_a_place_of_ones_own(
    workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "deep/er/street.obj"
    assert main(["export", str(workspace), "--triangles", "500", "-o", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"file": str(path), "files": [str(path)]}
    assert 400 < len(opened(path).faces) <= 500
    assert [p.name for p in path.parent.iterdir()] == ["street.obj"]
    assert main(["export", str(workspace), "--triangles", "500", "--to", "ply"]) == 0
    np.testing.assert_allclose(opened(workspace / "meshes/empty_500.ply").bounds, opened(path).bounds, atol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "no format is named (give one or more with --to"),
        (["--to", "stl"], "Not a format: stl (give one or more with --to: splat-ply, spz"),
        (["--to", "splat-ply"], "Name a folder (give one with -o)"),
        (["--to", "ply,obj", "-o", "workspace/frames/x"], "frames/x: Not for results: the workspace's own folder"),
        (
            ["--to", "nerfstudio", "--state", "full", "-o", "x"],
            "Not of this state: nerfstudio shows the empty street only",
        ),
        (["--to", "obj", "--start-frame", "-1"], "Not the number of a frame: --start-frame -1"),
        (["-o", "x/street.stl"], "street.stl: Not a mesh file (use ply, obj, glb)"),
        (["-o", "x/street"], "street: Not a mesh file"),
        (["--to", "obj", "-o", "x/street.glb"], "street.glb: Not the suffix of obj (name it .obj)"),
        (["--to", "obj", "--triangles", "3"], "empty.ply: 3 triangles make no surface (ask for at least 4)"),
        (["--to", "obj", "--triangles", "0"], "0 triangles make no surface"),
        (["--to", "obj", "--triangles", "-1"], "-1 triangles make no surface"),
        (["-o", "workspace/meshes/empty.ply"], "empty.ply: The workspace's own mesh lies here"),
        (["-o", "file/street.ply"], "file: Not a folder (name a file in a folder)"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    arguments: list[str],
    line: str,
    workspace: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(workspace.parent)
    Path("file").touch()
    before = {p: p.stat().st_mtime_ns for p in workspace.parent.rglob("*")}
    assert main(["export", "workspace", *arguments]) == 2
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1
    assert {p: p.stat().st_mtime_ns for p in workspace.parent.rglob("*")} == before


def test_no_mesh_yet(workspace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_ply(Mesh.empty(), workspace / "meshes/full.ply")
    assert main(["export", str(workspace), "--to", "glb", "--state", "full"]) == 2
    assert "full.ply: has no triangles" in capsys.readouterr().err
    (workspace / "meshes/empty.ply").unlink()
    assert main(["export", str(workspace), "--to", "glb"]) == 2
    error = capsys.readouterr().err
    assert "empty.ply: cannot be read" in error and "run `unveil mesh`" in error and error.count("\n") == 1


@pytest.mark.parametrize("name", ["drive/points.ply", "meshes/empty.ply"])
@pytest.mark.parametrize("how", ["one bit", "gone"])
def test_a_result_with_a_bit_that_turned_over_goes_out_with_no_export(
    name: str, how: str, workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root, file = workspace, workspace / name
    stage = {"drive": "import", "meshes": "mesh"}[name.split("/")[0]]
    (root / ".made").mkdir(exist_ok=True)
    (root / f".made/{stage}.json").write_text(json.dumps({"generator": GENERATOR, "files": {name: stamp_of(file)}}))
    assert main(["export", str(root), "--to", "ply", "-o", str(tmp_path / "a.ply")]) == 0
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.unlink() if how == "gone" else file.write_bytes(bytes(content))
    capsys.readouterr()
    assert main(["export", str(root), "--to", "ply", "-o", str(tmp_path / "b.ply")]) == 2
    said = capsys.readouterr().err
    assert (
        f"{Path(name).name}: {'Gone since' if how == 'gone' else 'Not as'} the stage {stage}" in said
        and said.count("\n") == 1
    )
    assert not (tmp_path / "b.ply").exists()
