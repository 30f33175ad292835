"""Charts of a workspace read, or filled with holes in them, by the program that Python finds: a script for a tree's environment.

    python fill_charts.py read WORKSPACE CHART.npz
    python fill_charts.py fill WORKSPACE CHART.npz HOLES OUTPUT [MECHANISM ...]

``read`` writes the planes of the whole street's chart, as the frames show it, and ``objects``, the numbers of the removed objects
that stand there. ``fill`` takes that chart, whatever the tree would have read itself, so that all trees fill the same one: for each
``HOLES/NAME.npz`` (``holes`` (A, B) uint16, the number of the hole, and ``footprint`` (A, B) bool, what stood there) it writes
``OUTPUT/NAME.npz`` with the filled ``color`` (A, B, 3) uint8. The tree finds the sun itself, once, without the holes.
The mechanisms, if any, do not work.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import no_progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.by_stretch import StreetFill
from unveil_core.inpaint.chart.footprint import footprint_of
from unveil_core.inpaint.chart.street_chart import OUTSIDE, PLANES, StreetChart, rows_of
from unveil_core.inpaint.light.sun import Sun
from unveil_core.inpaint.stretches import Stretch, cut_street
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import StageContext
from unveil_core.pipeline.steps.inpaint import _read
from unveil_core.workspace.workspace import Workspace

Planes = dict[str, NDArray[Any]]
UNSEEN = {"color": 0, "label": -1, "source": OUTSIDE, "gain": 1, "nearest": np.inf, "replaced": False}
"""By plane, what a texel has that no frame shows."""


class HoledStreet(StreetFill):
    """A street whose chart is given, with holes in it."""

    chart: Planes
    holes: NDArray[np.bool_]
    footprint: NDArray[np.bool_]

    def _read_own(self, stretch: Stretch) -> StreetChart:
        rows = slice(*stretch.rows)
        hole = self.holes[rows]
        planes = {
            name: np.where(_wide(hole, self.chart[name]), UNSEEN[name], self.chart[name][rows]) for name in PLANES
        }
        planes = {name: plane.astype(self.chart[name].dtype) for name, plane in planes.items()}
        s_start, t_start, texel = self.chart["place"]
        place = np.array([s_start + texel * stretch.rows[0], t_start, texel])
        return StreetChart.from_arrays(self.ground, {**planes, "place": place})

    def _footprint(self, stretch: Stretch, chart: StreetChart) -> NDArray[np.bool_]:
        first = round((chart.s_start - self.chart["place"][0]) / chart.texel)
        own: NDArray[np.bool_] = super()._footprint(stretch, chart)
        return own | self.footprint[first : first + len(own)]


def _wide(mask: NDArray[np.bool_], plane: NDArray[Any]) -> NDArray[np.bool_]:
    """A mask (A, B) that fits a plane of two or three axes."""
    return mask[..., None] if plane.ndim == 3 else mask


def open_street(workspace: Workspace, scratch: Path, kind: type[StreetFill]) -> StreetFill:
    """The street of a workspace, as the stage ``inpaint`` has it."""
    settings = RunSettings.from_json(workspace.state()["settings"])
    given = _read(StageContext(workspace, settings, no_progress, workspace.root, scratch))
    ground = read_ground(workspace.ground_npz).street
    if ground is None:
        raise SystemExit(f"No street was found: {workspace.root}.")
    gone = given.removal.surfels.means.double().numpy()[given.removal.gone]
    cameras = [f.camera for f in given.drive.frames]
    stretches = cut_street(ground, cut_into_blocks(given.drive), cameras, gone)
    context = StageContext(workspace, settings, no_progress, workspace.root, scratch)
    return kind(
        given.drive,
        given.scene,
        ground,
        given.removal,
        given.views,
        stretches,
        cache=context.cache,
        kept=Kept(scratch / "kept"),
    )


def read(root: Path, output: Path) -> None:
    """Write the chart of the whole street, and its objects."""
    with tempfile.TemporaryDirectory() as scratch:
        street = open_street(Workspace.open(root), Path(scratch), StreetFill)
        rows = rows_of(street.ground)
        planes: Planes = {}
        objects = np.zeros((0, 0), np.uint16)
        number = 0
        for stretch in street.stretches:
            chart = street._read_own(stretch)
            arrays = chart.arrays()
            for name in PLANES:
                plane = arrays[name]
                if name not in planes:
                    planes[name] = np.full((rows, *plane.shape[1:]), UNSEEN[name], plane.dtype)
                planes[name][slice(*stretch.rows)] = plane
            if not objects.size:
                objects = np.zeros((rows, chart.source.shape[1]), np.uint16)
            for means in street.removal.objects(street.near(stretch)):
                stands = footprint_of(chart, [means])
                if stands.any():
                    number += 1
                    objects[slice(*stretch.rows)][stands] = number
        texel = chart.texel
        place = np.array([street.ground.s_start, chart.t_start, texel])
    output.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(output, **{**planes, "objects": objects, "place": place})  # type: ignore[arg-type]


def fill(root: Path, chart: Path, holes: Path, output: Path) -> None:
    """Fill the chart with each set of holes in it."""
    with np.load(chart) as data:
        planes = {name: data[name] for name in data.files}
    if missing := [name for name in PLANES if name not in planes]:
        raise SystemExit(f"The kept chart has no {missing[0]}, which this tree wants. Read it anew with --fresh.")
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        street = open_street(Workspace.open(root), Path(scratch), HoledStreet)
        assert isinstance(street, HoledStreet)
        street.chart = planes
        street.holes = street.footprint = np.zeros(planes["source"].shape, dtype=bool)
        sun: Sun | None = street.find_sun()
        for path in sorted(holes.glob("*.npz")):
            with np.load(path) as data:
                street.holes, street.footprint = data["holes"] > 0, data["footprint"]
            street.kept = Kept(Path(scratch) / path.stem)
            filled = street.fill(sun, shadows=True) or street  # the street itself is what older trees fill
            color = np.zeros(planes["color"].shape, np.uint8)
            for stretch in street.stretches:
                color[slice(*stretch.rows)] = np.round(np.clip(filled.own(stretch).color, 0, 1) * 255)
            np.savez_compressed(output / path.name, color=color)


if __name__ == "__main__":
    given, names = [Path(path) for path in sys.argv[2:6]], sys.argv[6:]
    if sys.argv[1] == "read":
        read(*given)
    elif names:
        from unveil_core.base.mechanisms import without  # which older trees do not have

        with without(names):
            fill(*given)
    else:
        fill(*given)
