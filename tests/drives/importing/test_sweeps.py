"""One cloud from many sweeps: thinned, bounded, with classes, and with what moved marked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import DriveError
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import VOID
from unveil_core.drives.depth_range import FAR_M
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.drives.importing import sweeps as module
from unveil_core.drives.importing.sweeps import CELL_M, gathered, in_boxes, local_sweep
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity

CAMERA = Camera(4, 3, 4.0, 4.0, 2.0, 1.5, np.eye(4))


def sweep(points: object, classes: Sequence[int] | None = None, boxes: Sequence[TrackedBox] = ()) -> Sweep:
    positions = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    content = SweepPoints(positions, None if classes is None else np.asarray(classes, np.uint8))
    return Sweep(Path("sweep"), lambda: content, None, tuple(boxes))


def drive(*sweeps: Sweep) -> Drive:
    return Drive(
        Path("drive"), (Frame("00", "camera", CAMERA, Path("00.png")),), PointCloud(np.zeros((0, 3))), sweeps=sweeps
    )


def car(x: float, number: int = 1) -> TrackedBox:
    return TrackedBox(number, "car", (x, 0.0, 0.75), (4.0, 2.0, 1.5), 0.0)


def test_one_point_a_cell_that_of_the_earliest_sweep_with_its_class() -> None:
    generator = np.random.default_rng(0)
    clouds = [generator.uniform(-3, 3, (4000, 3)) * (1, 1, 0.02) for _ in range(3)]
    classes = [generator.integers(0, 19, 4000) for _ in range(3)]
    found = gathered(drive(*(sweep(p, c) for p, c in zip(clouds, classes, strict=True))))
    wanted: dict[tuple[int, ...], tuple[float, ...]] = {}
    for points, kinds in zip(clouds, classes, strict=True):
        for point, kind in zip(points, kinds, strict=True):
            wanted.setdefault(tuple(np.floor(point / CELL_M).astype(int)), (*point, float(kind)))
    assert found.classes is not None and found.measured and found.moving is None
    rows = {(*p, float(c)) for p, c in zip(found.positions, found.classes, strict=True)}
    assert rows == set(wanted.values()) and len(found.positions) == len(wanted) < 12000


def test_a_sweep_without_classes_among_such_with() -> None:
    found = gathered(drive(sweep([[1, 0, 0]]), sweep([[2, 0, 0]], [7])))
    assert found.classes is not None and sorted(found.classes) == [7, VOID]
    assert gathered(drive(sweep([[1, 0, 0]]))).classes is None


def test_points_of_what_moved_are_marked_and_of_what_stood_are_not() -> None:
    """The box drives from 10 m to 30 m; another stands at 50 m. The same places are free road in the other sweep."""
    places = [[10, 0, 1.0], [30, 0, 1.0], [50, 0, 1.0], [10, 0, 0.0]]
    standing = car(50.0, 2)
    found = gathered(drive(sweep(places, boxes=[car(10.0), standing]), sweep(places, boxes=[car(30.0), standing])))
    assert found.moving is not None
    rows = sorted((*p, bool(m)) for p, m in zip(found.positions.tolist(), found.moving, strict=True))
    # Where the moving car was in one sweep and was not in the other, both points stay: one does not hide the other.
    assert rows == [
        (10, 0, 0.0, False), (10, 0, 1.0, False), (10, 0, 1.0, True),
        (30, 0, 1.0, False), (30, 0, 1.0, True), (50, 0, 1.0, False),
    ]  # fmt: skip


def test_points_in_boxes_but_not_the_ground_below_them() -> None:
    box = TrackedBox(1, "car", (5.0, 2.0, 1.0), (4.0, 2.0, 2.0), np.pi / 2)
    inside = [[5, 2, 1], [5, 3.9, 1], [5.9, 2, 1.9], [6.1, 2, 1]]
    outside = [[5, 2, 0.05], [6.3, 2, 1], [5, 4.3, 1], [6.9, 2, 1], [5, 2, 2.3]]
    found = in_boxes(np.array([*inside, *outside], dtype=np.float64), [box])
    assert found.tolist() == [True] * 4 + [False] * 5
    assert not in_boxes(np.zeros((0, 3)), [box]).any() and not in_boxes(np.zeros((2, 3)), []).any()


def test_the_number_of_points_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_POINTS", 2000)
    generator = np.random.default_rng(1)
    held: list[int] = []

    class Cells(module._Cells):
        def with_points(self, *arguments: object) -> module._Cells:
            made = super().with_points(*arguments)  # type: ignore[arg-type]
            held.append(len(made.keys))
            return made

    monkeypatch.setattr(module, "_Cells", Cells)
    clouds = [generator.uniform(-20, 20, (1500, 3)) for _ in range(8)]
    found = gathered(drive(*(sweep(p, np.full(len(p), 3)) for p in clouds)))
    assert 200 < len(found.positions) <= 2000 and found.classes is not None and (found.classes == 3).all()
    # Cells grow by steps: those that are left are spread as evenly as those of the start.
    assert max(held) <= 2000 + 1500
    assert set(map(tuple, found.positions)) <= set(map(tuple, np.concatenate(clouds)))


def test_what_lies_beyond_sight_is_left_out_and_nothing_at_all_is_one_line() -> None:
    far = FAR_M + 1.0
    found = gathered(drive(sweep([[1, 0, 0], [far, 0, 0], [0, -far, 0]])))
    assert found.positions.tolist() == [[1, 0, 0]]
    with pytest.raises(DriveError, match="no points near the cameras"):
        gathered(drive(sweep([[far, 0, 0]]), sweep([])))


def test_sweeps_are_read_one_by_one_with_progress() -> None:
    """None is read twice or before its turn."""
    events: list[str] = []

    def reading(i: int) -> Callable[[], SweepPoints]:
        def read() -> SweepPoints:
            events.append(f"read {i}")
            return SweepPoints(np.array([[float(i), 0, 0]]))

        return read

    whole = drive(*(Sweep(Path(f"{i}"), reading(i)) for i in range(3)))
    gathered(whole, lambda done, total, message="", **_: events.append(f"{done} of {total}"))
    assert events == ["read 0", "1 of 3", "read 1", "2 of 3", "read 2", "3 of 3"]


def test_a_sweep_comes_to_local_coordinates_when_it_is_read() -> None:
    place = Similarity(2.0, np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([352155.0, 5812961, 36]))
    local = np.array([[1.0, 2, 3], [4, 5, 6]])
    there = local_sweep(sweep(place.to_world(local), [1, 2], [car(352155.0)]), place)
    found = there.read()
    assert np.allclose(found.positions, local, atol=1e-6) and found.classes is not None
    assert there.boxes[0].size == (2.0, 1.0, 0.75) and found.classes.tolist() == [1, 2]
