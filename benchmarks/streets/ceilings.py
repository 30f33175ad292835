"""Where the error of a run lies, and how near the photographs come to the truth: for streets whose truth has depth.

    python benchmarks/streets/ceilings.py WORKSPACE [...]

WORKSPACE is a finished one whose drive has a truth (``streets.py --keep DIR`` keeps them). Three tables a workspace, in
benchmarks/results/ceilings.json:

* ``transfer``: removed pixels that other frames show, coloured from the nearest of these by the *true* depth, against our frames on
  the same pixels. What is missing between the two is geometry and blending, not knowledge.
* ``bound``: PSNR of all removed pixels if those that other frames show were coloured so (those of the sky, and others that no
  photograph shows by the true depth, exactly), and those that nobody saw were the true empty street itself, blurred by so many
  pixels: all of its structure guessed right, and no more than that. ``grain``: the same with details of GRAIN times the true ones'
  strength laid over the blur, which nobody can place as they were: they cost what they add.
* ``parts``: the removed pixels by what they truly show (sky, ground, upright), whether any frame shows it, and where our colour is
  from: their share, their share of the squared error, and PSNR. Of that error, ``coarse`` is the share that survives a blur of 4
  pixels: a wrong thing rather than a wrong grain.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.pictures.decoding import read_image, read_label_image  # noqa: E402
from unveil_core.base.types import Float32, Float64, Mask  # noqa: E402
from unveil_core.drives.drive import Drive, Frame  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.evaluate.delivered import read_delivered  # noqa: E402
from unveil_core.evaluate.flicker import read_depth  # noqa: E402
from unveil_core.evaluate.pictures import fitted, truth_file, truth_mask  # noqa: E402
from unveil_core.geometry.camera import Camera  # noqa: E402
from unveil_core.geometry.images import grow, sample_at  # noqa: E402
from unveil_core.ground.files import read_ground  # noqa: E402
from unveil_core.ground.street import Ground  # noqa: E402
from unveil_core.workspace.files import frame_file  # noqa: E402
from unveil_core.workspace.workspace import Workspace  # noqa: E402

RESULTS = ROOT / "benchmarks/results/ceilings.json"
SAME, SAME_M = 0.03, 0.1
"""Difference of depth up to which another frame shows the same place, as a share of it, plus metres."""
MIXED_PX = 2
"""Width of the border of what is removed in which pixels are mixed."""
ON_GROUND_M, ON_GROUND = 0.35, 0.02
"""Height over the street up to which a place is ground, metres, plus a share of its distance."""
COARSE_PX = 4.0
BOUND_PX = (1.0, 2.0, 4.0)
"""Standard deviations of a Gaussian up to which unseen structure is taken to be guessed, pixels."""
GRAIN = 0.7
"""Least strength of invented details, as a share of the true ones', with which the picture does not look blurred."""
ORIGINS = ("photograph", "relit", "seen elsewhere", "continued", "invented")
SHOWN = ("sky", "ground", "upright")
LEAST = 0.005
"""Shares of the error below this are left out."""


@dataclass(frozen=True, eq=False)
class View:
    """A frame with its truth.

    Attributes:
        camera: of the frame; image, ours, true: (H, W, 3) photograph, clean frame and empty street, levels of 255.
        removed, unseen: (H, W) the truth's masks; barred: (H, W) what is no witness, removed things and their shadows.
        rows, columns: (P,) the removed pixels whose true depth is known; depth: (P,) it, metres, 0 for the sky.
        nearest: (H, W) the truth's depth, each pixel with that of the nearest known one.
        origin: (H, W) where our colours are from.
    """

    camera: Camera
    image: Float32
    ours: Float32
    true: Float32
    removed: Mask
    unseen: Mask
    barred: Mask
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    depth: Float64
    nearest: Float64
    origin: NDArray[np.uint8]


def view_of(workspace: Workspace, truth: Path, frame: Frame) -> View:
    """A frame as it is, as it became, and as it should be."""
    image = read_image(frame.image_path).astype(np.float32)
    height, width = image.shape[:2]

    def mask(name: str) -> Mask:
        found = truth_mask(truth / name, frame, image.shape)
        return np.zeros((height, width), dtype=bool) if found is None else found

    paths = [truth_file(truth / name, frame) for name in ("images", "depth")]
    if paths[0] is None or paths[1] is None:
        raise SystemExit(f"{truth}: has no images or no depth of {frame.name}")
    grid = read_depth(paths[1], frame.camera)
    removed, depth, step = mask("removed"), grid.depth, grid.step
    at = np.zeros_like(removed)
    at[np.ix_(*grid.pixels())] = True
    rows, columns = np.nonzero(removed & at)
    return View(
        camera=frame.camera,
        image=image,
        ours=read_delivered(workspace.root, frame).astype(np.float32),
        true=fitted(read_image(paths[0]), image.shape).astype(np.float32),
        removed=removed,
        unseen=mask("unseen"),
        barred=grow(removed | mask("shadow"), MIXED_PX),
        rows=rows,
        columns=columns,
        depth=depth[rows // step, columns // step],
        nearest=np.kron(depth, np.ones((step, step))),
        origin=read_label_image(frame_file(workspace.root / "provenance", frame)),
    )


def carried(view: View, others: list[View]) -> Float64:
    """(P, 3) colours of the places behind removed pixels as the nearest other photograph shows them; NaN where none does."""
    rays = view.camera.rays()[view.rows, view.columns]
    places = view.camera.centre + view.depth[:, None] * rays
    surface = view.depth > 0
    color, best = np.full((len(places), 3), np.nan), np.full(len(places), np.inf)
    for other in others:
        which, pixel, depth = other.camera.shown(places[surface], nearest=SAME_M)
        which = np.flatnonzero(surface)[which]
        x, y = pixel.astype(np.int64).T
        same = np.abs(other.nearest[y, x] - depth) < SAME * depth + SAME_M
        # The one that shows the place at the most similar size.
        apart = np.where(same & ~other.barred[y, x], np.abs(np.log(depth / view.depth[which])), np.inf)
        better = apart < best[which]
        which, pixel = which[better], pixel[better]
        color[which], best[which] = sample_at(other.image, pixel), apart[better]
    return color


def kinds(view: View, ground: Ground | None) -> NDArray[np.int64]:
    """(P,) what removed pixels truly show, as indices into :data:`SHOWN`; without a street all that is no sky is upright."""
    found = np.where(view.depth > 0, SHOWN.index("upright"), SHOWN.index("sky"))
    if ground is not None:
        places = view.camera.centre + view.depth[:, None] * view.camera.rays()[view.rows, view.columns]
        low = np.abs(ground.over(ground.path.to_street(places))) < ON_GROUND_M + ON_GROUND * view.depth
        found[low & (view.depth > 0)] = SHOWN.index("ground")
    return found


def psnr(squared: Float64) -> float | None:
    """Of squared differences in levels of 255."""
    return None if not squared.size else round(float(10 * np.log10(255**2 / max(squared.mean(), 1e-9))), 2)


def measured(workspace: Workspace, drive: Drive) -> dict[str, Any]:
    """All tables of a run."""
    if drive.truth_root is None:
        raise SystemExit(f"{workspace.root}: its drive has no truth")
    views = [view_of(workspace, drive.truth_root, f) for f in drive.frames]
    ground = read_ground(workspace.ground_npz).street
    transfer: list[Float64] = []
    parts: list[Float64] = []
    bounds: list[Float64] = []
    grains: list[Float64] = []
    for view in views:
        at = view.rows, view.columns
        true, ours = view.true[at].astype(np.float64), view.ours[at]
        error = np.square(ours - true).mean(axis=1)
        coarse = np.square(cv2.GaussianBlur(view.ours - view.true, (0, 0), COARSE_PX)[at]).mean(axis=1)
        parts.append(np.column_stack([kinds(view, ground), view.unseen[at], view.origin[at], error, coarse]))
        seen = ~view.unseen[at]
        by_truth = np.square(carried(view, [v for v in views if v is not view]) - true).mean(axis=1)
        soft = [np.square(cv2.GaussianBlur(view.true, (0, 0), px)[at] - true).mean(axis=1) for px in BOUND_PX]
        for found, share in ((bounds, 0.0), (grains, GRAIN)):
            unseen = (1 + share**2) * np.column_stack(soft)
            found.append(np.where(seen[:, None], np.nan_to_num(by_truth)[:, None], unseen))
        transfer.append(np.column_stack([by_truth, error])[seen])
    pairs, rows = np.concatenate(transfer), np.concatenate(parts)
    there = np.isfinite(pairs[:, 0])
    total = rows[:, 3].sum()
    table = []
    for kind, name in enumerate(SHOWN):
        for unseen in (False, True):
            for number, origin in enumerate(ORIGINS):
                own = rows[(rows[:, 0] == kind) & (rows[:, 1] == unseen) & (rows[:, 2] == number)]
                if own[:, 3].sum() < LEAST * total:
                    continue
                table.append(
                    {
                        "shows": name,
                        "seen_elsewhere": not unseen,
                        "from": origin,
                        "share": round(len(own) / len(rows), 3),
                        "error_share": round(own[:, 3].sum() / total, 3),
                        "psnr": psnr(own[:, 3]),
                        "coarse": round(own[:, 4].sum() / own[:, 3].sum(), 2),
                    }
                )
    return {
        "removed": psnr(rows[:, 3]),
        "transfer": {"share": round(float(there.mean()), 3), "true": psnr(pairs[there, 0]), "ours": psnr(pairs[there, 1])},
        **{
            name: {f"{px:g} px": psnr(e) for px, e in zip(BOUND_PX, np.concatenate(found).T, strict=True)}
            for name, found in (("bound", bounds), ("grain", grains))
        },
        "parts": table,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("workspaces", nargs="+", type=Path)
    results = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    for folder in parser.parse_args().workspaces:
        workspace = Workspace.open(folder)
        results[folder.name] = found = measured(workspace, read_imported(workspace.drive_dir, points=False))
        print(folder.name, *(found[name] for name in ("removed", "transfer", "bound", "grain")))
        for row in found["parts"]:
            print("   ", *(f"{k} {v}" for k, v in row.items()))
        write_json_atomic(RESULTS, results)


if __name__ == "__main__":
    main()
