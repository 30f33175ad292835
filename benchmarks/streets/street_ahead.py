"""How far aside of the true street its path lies ahead of the last camera, as driven and as followed: for streets drawn by seed.

    python benchmarks/streets/street_ahead.py SEED=WORKSPACE [...]

WORKSPACE is a finished run of that seed's drive (``streets.py --keep DIR`` keeps them). The course that a seed draws is
the truth; of a way that turns, or ends amid a corner, it is the street that the path is nearer to. In
benchmarks/results/street_ahead.json: metres aside of it 10, 20, 30 and 40 m ahead, of the path prolonged as the car drove
(``driven``) and of the workspace's (``followed``).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from sample_scenes.generators.streets.cameras import shots  # noqa: E402
from sample_scenes.generators.streets.draw import draw  # noqa: E402
from sample_scenes.generators.streets.path import Path as Course  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.types import Float64  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.ground.files import read_ground  # noqa: E402
from unveil_core.ground.path import StreetPath, fit_path  # noqa: E402
from unveil_core.ground.track import longest_track  # noqa: E402
from unveil_core.workspace.workspace import Workspace  # noqa: E402

RESULTS = ROOT / "benchmarks/results/street_ahead.json"
AHEAD_M = (10, 20, 30, 40)


def beside(course: Course, places: Float64) -> Float64:
    """(N,) how much farther to the left of a street places (N + 1, 2) lie than the first of them."""
    nearest = np.square(places[:, None] - course.xy).sum(axis=2).argmin(axis=1)
    apart, angle = places - course.xy[nearest], course.angle[nearest]
    left: Float64 = apart[:, 1] * np.cos(angle) - apart[:, 0] * np.sin(angle)
    return left[1:] - left[0]


def measured(seed: int, workspace: Workspace) -> dict[str, Any] | None:
    """The offsets of a run; None where it found no street."""
    drive = read_imported(workspace.drive_dir, points=False)
    ground = read_ground(workspace.ground_npz).street
    if ground is None:
        return None
    plan = draw(seed, "usual")
    cameras = [drive.frames[i].camera for i in longest_track(drive)]
    # A drive keeps its place in the world to itself.
    away = shots(plan)[0].told[:3, 3] - drive.frames[0].camera.centre

    def aside(path: StreetPath) -> list[float]:
        end = float(path.to_street(cameras[-1].centre[None])[0, 0])
        s = end + np.array([0, *AHEAD_M], dtype=np.float64)
        at: Float64 = (path.to_world(np.column_stack([s, np.zeros((len(s), 2))])) + away)[:, :2]
        of_streets = [beside(leg.path, at) for leg in plan.legs]
        return [round(float(v), 2) for v in min(of_streets, key=lambda left: abs(left[-1]))]

    kind = {"course": plan.course["kind"], "turn_degrees": plan.course["turn_degrees"]}
    return {**kind, "driven": aside(fit_path(cameras)), "followed": aside(ground.path)}


def main() -> None:
    """Measure the workspaces of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="SEED=WORKSPACE")
    document: dict[str, Any] = {"ahead_m": AHEAD_M, "streets": {}}
    if RESULTS.is_file():
        document = json.loads(RESULTS.read_text())
    streets = document["streets"]
    for run in parser.parse_args().runs:
        seed, _, folder = run.partition("=")
        found = measured(int(seed), Workspace.open(Path(folder)))
        if found is not None:
            streets[seed] = found
            print(seed, found, flush=True)
    document["streets"] = dict(sorted(streets.items(), key=lambda item: int(item[0])))
    for name in ("driven", "followed"):
        rows = np.abs([row[name] for row in streets.values()])
        document[name] = {
            "mean": [round(float(v), 2) for v in rows.mean(axis=0)],
            "median": [round(float(v), 2) for v in np.median(rows, axis=0)],
        }
        print(name, document[name])
    write_json_atomic(RESULTS, document)


if __name__ == "__main__":
    main()
