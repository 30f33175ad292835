"""Fits and checks the certainty of delivered pixels on finished workspaces of drives with truth.

    python benchmarks/streets/certainty.py WORKSPACE ... --planted WORKSPACE ... [--check WORKSPACE ...]

For each origin a logistic function of the doubts is fitted (unveil_core/provenance), to drawn streets and to real drives with
planted cars (``real_drives/real.py`` makes these runs: CACHE/DRIVE/round_N/runs/KEY/workspace), of which the pixels behind the
cars are read. Each drive is also predicted by a fit to all others: the reliability is that of drives that the fit has not seen,
and what is called certain is chosen by the real ones. What follows ``--check`` is predicted by the fit to all before. Results go
to benchmarks/results/certainty.json; the models in unveil_core/provenance/certainty.py are copied from there.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.real_drives.planted import kept_rounds  # noqa: E402
from unveil_core.base.frame_cache import FrameCache  # noqa: E402
from unveil_core.base.pictures.decoding import read_image  # noqa: E402
from unveil_core.base.types import Mask, Picture  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.drives.drive import Frame  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.evaluate.delivered import read_delivered  # noqa: E402
from unveil_core.evaluate.pictures import fitted, truth_file  # noqa: E402
from unveil_core.inpaint.origin import CONTINUED, INVENTED, ORIGINAL, RELIT, SEEN_ELSEWHERE  # noqa: E402
from unveil_core.provenance.certainty import CEILINGS, ORIGINAL_LEVEL, certainty_levels, expected_right, right_pixels  # noqa: E402
from unveil_core.provenance.doubts import DOUBTS  # noqa: E402
from unveil_core.provenance.of_workspace import looks_of, provenance_of  # noqa: E402
from unveil_core.surfels.ply import read_surfels  # noqa: E402

RESULTS = ROOT / "benchmarks/results/certainty.json"
KINDS = {"relit": RELIT, "seen_elsewhere": SEEN_ELSEWHERE, "continued": CONTINUED, "invented": INVENTED}
BINS = (0.0, 0.6, 0.8, 0.9, 0.95, 1.0)
"""Limits of the expectation: most pixels are expected to be right, so that equal bins would say little of them."""
RIDGE = 1e-3
"""Weight of the squares of the weights in the fit: what tells the same twice shares it."""
MOST_FITTED = 5000
"""Pixels of each origin and drive that a fit looks at, drawn evenly: neighbours are right or wrong together, so that more
tell little more, and a fit to 19 drives would take minutes."""
PURITY = 0.95
"""Share of the pixels called certain that has to be right, behind planted cars of real drives that the fit has not seen, all
counting the same."""
LEVELS = (224, 228, 232, 236, 240, 244, 248)
"""Levels at which the means over drives are written down."""
LEAST_CALLED = 50
"""Pixels of a drive that have to be called, so that their share counts."""

Models = dict[int, tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class Sample:
    """P changed pixels of a workspace: name; real, whether it is of a real drive; origin (P,), doubts (P, D), right (P,)."""

    name: str
    real: bool
    origin: NDArray[np.uint8]
    doubts: NDArray[np.float32]
    right: NDArray[np.bool_]


Truth = Callable[[int, Frame], tuple[Picture, Mask] | None]
"""Of a frame by its number the true empty street (H, W, 3) and where (H, W) it is known; None where it is not."""


def drawn_truth(root: Path) -> Truth:
    """Of a workspace of a drive that has a truth folder."""
    truth_root = read_imported(root / "drive", points=False).truth_root

    def of(_: int, frame: Frame) -> tuple[Picture, Mask] | None:
        path = None if truth_root is None else truth_file(truth_root / "images", frame)
        if path is None:
            return None
        shape = (frame.camera.height, frame.camera.width)
        return fitted(read_image(path), shape), np.ones(shape, bool)

    return of


def planted_truth(root: Path) -> Truth:
    """Of a workspace of a planted drive: the photographs behind the cars."""
    kept = next(r for r in kept_rounds(root.parents[3]) if r.folder == root.parents[2])
    held = kept.frames()
    return lambda i, _: (read_image(held[i].frame.image_path), held[i].region)


def read_sample(root: Path, truth: Truth, name: str, *, real: bool) -> Sample:
    """All changed pixels of a workspace that the truth shows."""
    drive = read_imported(root / "drive", points=False)
    surfels = read_surfels(root / "surfels/empty.ply")
    origins, doubts, right = [], [], []
    with tempfile.TemporaryDirectory() as scratch:
        cache = FrameCache()
        looks = looks_of(root, drive.frames, surfels, cache, Path(scratch))
        for i, known in enumerate(provenance_of(root, root, drive.frames, looks, cache)):
            shown = truth(i, known.frame)
            if shown is None:
                continue
            street, where = shown
            changed = known.origin != ORIGINAL
            asked = where[changed]
            origins.append(known.origin[changed][asked])
            doubts.append(known.doubts[asked])
            right.append(right_pixels(read_delivered(root, known.frame), street)[changed][asked])
    return Sample(name, real, np.concatenate(origins), np.concatenate(doubts), np.concatenate(right))


def fit(samples: list[Sample]) -> Models:
    """A model of each origin; all drives count the same, whatever their number of pixels."""
    models: Models = {}
    for kind in KINDS.values():
        parts = [(s.doubts[s.origin == kind], s.right[s.origin == kind]) for s in samples]
        parts = [_drawn(*p) for p in parts if len(p[0])]
        if not parts:
            models[kind] = (0.0,) + (0.0,) * len(DOUBTS)
            continue
        doubts = np.concatenate([d for d, _ in parts]).astype(np.float64)
        right = np.concatenate([r for _, r in parts])
        share = np.concatenate([np.full(len(d), 1 / len(d)) for d, _ in parts])
        models[kind] = _logistic(doubts, right, share / share.sum(), CEILINGS[kind])
    return models


def _drawn(doubts: NDArray[np.float32], right: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """At most ``MOST_FITTED`` of the pixels."""
    if len(right) <= MOST_FITTED:
        return doubts, right
    some = np.random.default_rng(0).choice(len(right), MOST_FITTED, replace=False)
    return doubts[some], right[some]


def _logistic(
    doubts: NDArray[np.float64], right: NDArray[np.bool_], share: NDArray[np.float64], ceiling: float
) -> tuple[float, ...]:
    """The constant and the weights for which pixels (P,) with their shares of the whole are most likely."""

    def loss(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        score = x[0] - doubts @ x[1:]
        inner = 1 / (1 + np.exp(-np.clip(score, -50, 50)))
        expected = np.clip(ceiling * inner, 1e-9, 1 - 1e-9)
        cost = -share @ np.where(right, np.log(expected), np.log(1 - expected)) + RIDGE * np.square(x[1:]).sum()
        by_expected = share * np.where(right, -1 / expected, 1 / (1 - expected))
        slope = by_expected * ceiling * inner * (1 - inner)
        return float(cost), np.concatenate([[slope.sum()], -(doubts.T @ slope) + 2 * RIDGE * x[1:]])

    start = np.concatenate([[1.0], np.full(len(DOUBTS), 0.1)])
    bounds = [(None, None)] + [(0.0, None)] * len(DOUBTS)
    found = minimize(loss, start, jac=True, bounds=bounds, method="L-BFGS-B").x
    return tuple(round(float(v), 3) for v in found)


def levels_of(sample: Sample, models: Models) -> NDArray[np.uint8]:
    """(P,) certainty of a workspace's pixels."""
    return certainty_levels(expected_right(sample.origin, sample.doubts, models))


def _right_shares(predicted: list[tuple[NDArray[np.uint8], NDArray[np.bool_]]], level: int) -> list[float]:
    """Of each drive with enough pixels from a level on, the share of these that are right."""
    called = [right[levels >= level] for levels, right in predicted]
    return [c.mean() for c in called if len(c) >= LEAST_CALLED]


def threshold(predicted: list[tuple[NDArray[np.uint8], NDArray[np.bool_]]]) -> int:
    """The lowest level from which on ``PURITY`` is right on the mean of all drives; the highest where none is."""
    for level in range(128, ORIGINAL_LEVEL):
        shares = _right_shares(predicted, level)
        if not shares or np.mean(shares) >= PURITY:
            return level
    return ORIGINAL_LEVEL - 1


def reliability(levels: NDArray[np.uint8], right: NDArray[np.bool_], certain: int) -> dict[str, object]:
    """Expected and actual share of right pixels by bins of the expectation, and what is called certain."""
    expected = levels / (ORIGINAL_LEVEL - 1)
    number = np.clip(np.digitize(expected, BINS) - 1, 0, len(BINS) - 2)
    rows = [
        {
            "from": BINS[k],
            "share": round(float((number == k).mean()), 4),
            "expected": round(float(expected[number == k].mean()), 4),
            "right": round(float(right[number == k].mean()), 4),
        }
        for k in range(len(BINS) - 1)
        if (number == k).any()
    ]
    called = levels >= certain
    error = sum(r["share"] * abs(r["expected"] - r["right"]) for r in rows)
    return {
        "pixels": len(right),
        "right": round(float(right.mean()), 4),
        "called_certain": round(float(called.mean()), 4),
        "certain_right": round(float(right[called].mean()), 4) if called.any() else None,
        "calibration_error": round(error, 4),
        "bins": rows,
    }


def _mean(predicted: list[tuple[NDArray[np.uint8], NDArray[np.bool_]]], certain: int) -> dict[str, object]:
    """Over drives, all counting the same: what is called certain, how much of that is right, and on the worst drive; likewise from
    other levels on."""

    def at(level: int) -> dict[str, float]:
        shares = _right_shares(predicted, level)
        share = np.mean([(levels >= level).mean() for levels, _ in predicted])
        names = ("called_certain", "certain_right", "worst")
        values = (share, np.mean(shares), np.min(shares)) if shares else (share, np.nan, np.nan)
        return {name: round(float(v), 4) for name, v in zip(names, values, strict=True) if np.isfinite(v)}

    return (
        {"drives": len(predicted), **at(certain), "levels": {level: at(level) for level in LEVELS}} if predicted else {}
    )


def main() -> None:
    """Fit, predict each drive by a fit to the others, and write the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drawn", nargs="*", type=Path, help="workspaces of drives with a truth folder")
    parser.add_argument("--planted", nargs="+", type=Path, default=[], help="workspaces of planted drives")
    parser.add_argument("--check", nargs="+", type=Path, default=[], help="workspaces that are not fitted to")
    arguments = parser.parse_args()
    samples = [read_sample(root, drawn_truth(root), root.name, real=False) for root in arguments.drawn]
    for root in (path.resolve() for path in arguments.planted):
        samples.append(read_sample(root, planted_truth(root), root.parents[3].name, real=True))
    checks = [read_sample(root, drawn_truth(root), root.name, real=False) for root in arguments.check]
    models = fit(samples)
    by_others = []
    for one in samples:
        others = [s for s in samples if s is not one]
        by_others.append((levels_of(one, fit(others) if others else models), one.right))
    groups = {
        name: [p for s, p in zip(samples, by_others, strict=True) if s.real == real]
        for name, real in (("drawn", False), ("real", True))
    }
    certain = threshold(groups["real"] or groups["drawn"])
    predicted = [(levels_of(s, models), s.right) for s in checks]
    document = {
        "machine": machine(),
        "doubts": list(DOUBTS),
        "ceilings": {name: CEILINGS[kind] for name, kind in KINDS.items()},
        "models": {name: models[kind] for name, kind in KINDS.items()},
        "certain": certain,
        "mean": {
            "not_fitted_on": _mean(by_others, certain),
            **{n: _mean(g, certain) for n, g in groups.items()},
            "checked": _mean(predicted, certain),
        },
        "not_fitted_on": {s.name: reliability(p, r, certain) for s, (p, r) in zip(samples, by_others, strict=True)},
        "checked": {
            s.name: reliability(levels, right, certain) for s, (levels, right) in zip(checks, predicted, strict=True)
        },
        "origins": {
            s.name: {
                name: {
                    "share": round(float((s.origin == kind).mean()), 4),
                    "right": round(float(s.right[s.origin == kind].mean()), 4) if (s.origin == kind).any() else None,
                }
                for name, kind in KINDS.items()
            }
            for s in samples + checks
        },
    }
    RESULTS.write_text(json.dumps(document, indent=1) + "\n")
    json.dump(document, sys.stdout, indent=1)


if __name__ == "__main__":
    main()
