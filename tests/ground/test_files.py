"""The ground on disk: the same again, and a clear error for everything that is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.ground.test_street import drive_on_circle, street_points
from unveil_core.base.errors import WorkspaceError
from unveil_core.ground.files import read_ground, write_ground
from unveil_core.ground.fit import DriveGround
from unveil_core.ground.height_field import HeightField
from unveil_core.ground.path import fit_path
from unveil_core.ground.street_fit import fit_street_heights

CAMERAS = drive_on_circle(60.0, 0.03)
PATH = fit_path(CAMERAS)
FIELD = HeightField(np.eye(3), np.zeros(2), 0.5, np.where(np.eye(4) > 0, np.nan, 1.0))
WHOLE = DriveGround(PATH, fit_street_heights(PATH, street_points(60.0, 0.03)), FIELD)


def test_it_comes_back_as_it_was(tmp_path: Path) -> None:
    for ground in (WHOLE, DriveGround(PATH, None, FIELD), DriveGround(PATH, WHOLE.street, None)):
        write_ground(ground, tmp_path / "ground.npz")
        first = (tmp_path / "ground.npz").read_bytes()
        found = read_ground(tmp_path / "ground.npz")
        write_ground(found, tmp_path / "ground.npz")
        assert (tmp_path / "ground.npz").read_bytes() == first
        assert (found.street is None, found.terrain is None) == (ground.street is None, ground.terrain is None)
        if found.street is not None and ground.street is not None:
            rays = CAMERAS[3].rays().reshape(-1, 3)
            for a, b in zip(
                found.street.intersect(CAMERAS[3], rays), ground.street.intersect(CAMERAS[3], rays), strict=True
            ):
                assert np.array_equal(a, b)


def damaged(**changes: object) -> dict[str, np.ndarray]:
    street = WHOLE.street
    assert street is not None
    arrays = {
        "axes": PATH.axes,
        "path_nodes": PATH.nodes,
        "path_heading": PATH.heading,
        "path_start": PATH.start,
        "path_step": PATH.step,
        "street_height": street.height,
        "street_first": np.array([street.s_start, street.t_start]),
        "street_cell": np.array([1.0, 0.1]),
        "street_limits": np.stack([street.t_min, street.t_max]),
        **changes,
    }
    return {k: np.asarray(v) for k, v in arrays.items() if v is not None}


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"axes": np.eye(3) * 2}, "not a rotation: axes"),
        ({"axes": None}, "axes"),
        ({"path_nodes": PATH.nodes[:, :1]}, "path_nodes holds float64"),
        ({"path_nodes": PATH.nodes * 1e6}, "path_nodes leap"),
        ({"path_nodes": PATH.nodes[:0]}, "path_nodes holds float64"),
        ({"path_heading": PATH.heading[:-1]}, "path_heading holds float64"),
        ({"path_step": 0.0}, "not above 0: path_step"),
        ({"path_start": np.nan}, "not finite: path_start"),
        ({"street_height": np.full((5, 5), np.inf)}, "not finite: street_height"),
        ({"street_limits": np.zeros((2, 3))}, "street_limits holds float64"),
        ({"street_cell": np.array([1.0, -0.1])}, "not above 0: street_cell"),
        ({"street_height": np.array([["a"]])}, "street_height holds <U1"),
    ],
)
def test_what_is_no_ground_is_one_clear_line(tmp_path: Path, changes: dict[str, object], problem: str) -> None:
    path = tmp_path / "ground.npz"
    np.savez(path, **damaged(**changes))
    with pytest.raises(WorkspaceError, match=problem) as caught:
        read_ground(path)
    assert "run `unveil ground` again" in str(caught.value) and str(path) in str(caught.value)


def test_nothing_is_unpickled_and_nothing_half_read(tmp_path: Path) -> None:
    path = tmp_path / "ground.npz"
    with pytest.raises(WorkspaceError, match="Not found"):
        read_ground(path)
    np.savez(path, axes=np.array([{"a": 1}], dtype=object))
    with pytest.raises(WorkspaceError, match="Not a readable ground"):
        read_ground(path)
    write_ground(WHOLE, path)
    for content in (b"", b"ground", path.read_bytes()[:-200], path.read_bytes()[:400] + path.read_bytes()[500:]):
        path.write_bytes(content)
        with pytest.raises(WorkspaceError, match="Not a readable ground"):
            read_ground(path)
