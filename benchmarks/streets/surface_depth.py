"""How wrong the depth of a scene is, by how it is taken from what is rendered: for streets whose truth has depth.

    python benchmarks/streets/surface_depth.py WORKSPACE [...]

WORKSPACE is one whose scenes are made and whose drive has a truth (``streets.py --keep DIR`` keeps them). In
benchmarks/results/surface_depth.json, by workspace, scene, part of the picture (in view: nothing was removed from it; of the empty
scene also what other frames show, and what none does) and place (edge: within EDGE_PX of a jump of the true depth; surface:
elsewhere): ``pixels``, and by definition the share of them whose depth is ``right``, within SAME of the true one, the share that is
``wrong`` by more than WRONG, and the ``median`` error, all as shares of the true depth. The definitions: ``mean`` and ``median`` as
the rasterizer has them, and the mean where it is within so much of the median, else the median: ``mean within 0.03`` is what the
program works with. ``barely covered``: of the pixels with a surface the share with alpha up to BARELY, and of these those that
are right, and those that truly show the sky.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.types import Float64, Mask  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.delivery.views import SAME_DEPTH  # noqa: E402
from unveil_core.drives.depth_range import FAR_M, NEAR_M  # noqa: E402
from unveil_core.drives.drive import Drive, Frame  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.evaluate.flicker import DepthGrid, read_depth  # noqa: E402
from unveil_core.evaluate.pictures import truth_file, truth_mask  # noqa: E402
from unveil_core.raster.near_camera import near_camera  # noqa: E402
from unveil_core.raster.on_device import array, rendered  # noqa: E402
from unveil_core.surfels.ply import read_surfels  # noqa: E402
from unveil_core.surfels.surfels import Surfels  # noqa: E402
from unveil_core.view.surface import SOLID, SURFACE_PLANES  # noqa: E402

RESULTS = ROOT / "benchmarks/results/surface_depth.json"
SAME, WRONG = SAME_DEPTH, 0.1
JUMP, EDGE_PX = 1.1, 2
"""Factor between the true depths of neighbouring samples from which on they are of two surfaces, as fusion has it; pixels."""
FARTHEST_M = 60.0
"""Only what is nearer counts: farther off a share of the depth is metres, and no photograph is used for it."""
WITHIN = (0.01, 0.03, 0.05, 0.1)
USED, BARELY = "mean within 0.03", 0.7
"""What the program works with; alpha up to which a pixel with a surface counts as barely covered."""
PARTS = ("in view", "seen elsewhere", "never seen")


def definitions(surfels: Surfels, frame: Frame) -> tuple[dict[str, Float64], Float64]:
    """(H, W) depth by definition, and alpha (H, W)."""
    out = rendered(near_camera(surfels, frame.camera), frame.camera, SURFACE_PLANES, near=NEAR_M, far=FAR_M)
    alpha, median = array(out.alpha), array(out.median_depth)
    mean = array(out.depth) / np.maximum(alpha, SOLID)
    found = {"mean": mean, "median": median}
    for share in WITHIN:
        found[f"mean within {share}"] = np.where(np.abs(mean - median) < share * median, mean, median)
    return found, alpha


def at_edges(depth: Float64, step: int) -> Mask:
    """(h, w) samples of the true depth (h, w; 0 the sky) beside a jump; ``step``: pixels from one to the next."""
    away = np.where(depth > 0, depth, np.inf)
    edge = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        one, two = (np.take(away, np.arange(k, away.shape[axis] - 1 + k), axis) for k in (0, 1))
        with np.errstate(invalid="ignore"):
            jump = ~(np.maximum(one, two) <= JUMP * np.minimum(one, two)) & (np.isfinite(one) | np.isfinite(two))
        aside = np.zeros_like(np.take(jump, [0], axis))
        edge |= np.concatenate([jump, aside], axis) | np.concatenate([aside, jump], axis)
    reach = max(1, EDGE_PX // step)
    return cv2.dilate(edge.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) > 0


def parts_of(truth: Path, frame: Frame, grid: DepthGrid, state: str) -> dict[str, Mask]:
    """(h, w) samples by part of the picture."""
    shape = (frame.camera.height, frame.camera.width)

    def mask(name: str) -> Mask:
        found = truth_mask(truth / name, frame, shape)
        return (np.zeros(shape, dtype=bool) if found is None else found)[np.ix_(*grid.pixels())]

    removed, unseen = mask("removed"), mask("unseen")
    found = dict(zip(PARTS, (~removed, removed & ~unseen, removed & unseen), strict=True))
    return found if state == "empty" else {"in view": ~removed}


def measured(drive: Drive, surfels: Surfels, state: str) -> dict[str, Any]:
    """The figures of a scene."""
    assert drive.truth_root is not None
    errors: dict[tuple[str, str, str], list[Float64]] = defaultdict(list)
    barely: list[Float64] = []
    pixels = 0
    for frame in drive.frames:
        path = truth_file(drive.truth_root / "depth", frame)
        if path is None:
            continue
        grid = read_depth(path, frame.camera)
        found, alpha = definitions(surfels, frame)
        at, edge = np.ix_(*grid.pixels()), at_edges(grid.depth, grid.step)
        near, solid = grid.depth < FARTHEST_M, alpha[at] > SOLID
        counted = (grid.depth > 0) & near & solid
        parts = parts_of(drive.truth_root, frame, grid, state)
        shown = np.logical_or.reduce(list(parts.values())) & near & solid
        few, pixels = shown & (alpha[at] <= BARELY), pixels + int(shown.sum())
        with np.errstate(divide="ignore"):
            barely.append(np.abs(found[USED][at][few] / grid.depth[few] - 1))  # inf for the sky
        for part, inside in parts.items():
            for place, there in (("edge", edge), ("surface", ~edge)):
                which = counted & inside & there
                for name, depth in found.items():
                    errors[part, place, name].append(np.abs(depth[at][which] / grid.depth[which] - 1))
    figures: dict[str, Any] = {}
    for (part, place, name), several in errors.items():
        off = np.concatenate(several)
        of_place = figures.setdefault(part, {}).setdefault(place, {"pixels": len(off)})
        if len(off):
            shares = {"right": np.mean(off < SAME), "wrong": np.mean(off > WRONG), "median": np.median(off)}
            of_place[name] = {key: round(float(value), 4) for key, value in shares.items()}
    off = np.concatenate(barely)
    shares = {"share": len(off) / pixels, "right": np.mean(off < SAME), "sky": np.mean(np.isinf(off))}
    figures["barely covered"] = {key: round(float(value), 4) for key, value in shares.items()}
    return figures


def main() -> None:
    """Measure, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("workspaces", nargs="+", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    streets: dict[str, Any] = {}
    for root in arguments.workspaces:
        drive = read_imported(root / "drive", points=False)
        streets[root.name] = {
            state: measured(drive, read_surfels(root / f"surfels/{state}.ply"), state) for state in ("full", "empty")
        }
        for state, parts in streets[root.name].items():
            for part, places in parts.items():
                for place, row in places.items() if part != "barely covered" else ():
                    print(f"{root.name} {state}, {part}, {place}: {row['pixels']} pixels")
                    for name, figures in row.items():
                        if name != "pixels":
                            print(f"    {name:16s}", figures)
    write_json_atomic(arguments.output, {"machine": machine(), "streets": streets})


if __name__ == "__main__":
    main()
