"""Drives on which an assumption does not hold: each ends with frames all the same, and says what it did instead."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.hard_drives import DRAFT, make_tiny_drive, make_tiny_street, unchanged_outside
from tests.small_street import HIGH, LOW
from unveil_core.pipeline.run import run
from unveil_core.workspace.assumptions import Assumption, assumed, recorded_assumptions
from unveil_core.workspace.workspace import Workspace


def around(centre: np.ndarray, radius: float, count: int, height: float = 1.6) -> list[np.ndarray]:
    """OpenGL poses (4, 4) on a circle, looking at its centre."""
    poses = []
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False):
        place = centre + radius * np.array([np.cos(angle), np.sin(angle), 0]) + [0, 0, height]
        forward = centre + [0, 0, 0.5] - place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(right, forward), -forward, place
        poses.append(pose)
    return poses


def outcome(drive: Path, folder: Path) -> tuple[Workspace, dict[str, Assumption], list[dict[str, Any]]]:
    """The workspace of a whole run, what it assumed by name, and the events that it told."""
    events: list[dict[str, Any]] = []
    workspace = run(drive, folder, DRAFT, until="deliver", reporter=events.append)
    stages = json.loads((workspace.root / "workspace.json").read_text())["stages"]
    return workspace, {a.name: a for _, a in recorded_assumptions(stages)}, events


def test_an_orbit_is_no_street(tmp_path: Path) -> None:
    centre = np.array([(LOW[0] + HIGH[0]) / 2, 0.0, 0.0])
    drive = make_tiny_drive(tmp_path / "drive", around(centre, 4.5, 12))
    workspace, found, events = outcome(drive, tmp_path / "workspace")
    assert not found["the way is one street"].holds
    assert "the sun shines" not in found  # without a chart nobody asks
    told = [str(e["message"]) for e in events if e.get("level") == "notice"]
    assert any("one street" in line and "without charts" in line for line in told)
    assert unchanged_outside(workspace.root, drive)


def test_a_street_under_an_even_sky_is_one_without_sun(tmp_path: Path) -> None:
    drive = make_tiny_street(tmp_path / "drive", [float(i) for i in range(8)])
    workspace, found, _ = outcome(drive, tmp_path / "workspace")
    assert found["the way is one street"].holds
    assert found["the camera drives"].holds
    assert not found["the sun shines"].holds
    assert unchanged_outside(workspace.root, drive)


def test_what_a_stage_records_is_read_back() -> None:
    one = Assumption("the sun shines", False, "no direction", "dark patches count")
    assert recorded_assumptions({"inpaint": assumed([one]), "mesh": {"assumptions": [{"odd": 1}]}, "x": 3}) == [
        ("inpaint", one)
    ]
    assert one.message() == "not so: the sun shines (no direction); dark patches count"


@pytest.mark.parametrize("jitter", [0.01])
def test_a_stop_with_noise_is_no_way(tmp_path: Path, jitter: float) -> None:
    drive = make_tiny_street(tmp_path / "drive", [*map(float, range(6)), *(5.0 + jitter * np.sin(np.arange(6) * 2.3))])
    workspace, found, _ = outcome(drive, tmp_path / "workspace")
    assert found["the way is one street"].holds
    assert found["the camera drives"].found == "5.0 m of way"
    assert unchanged_outside(workspace.root, drive)
