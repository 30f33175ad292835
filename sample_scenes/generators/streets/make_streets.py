"""Render streets by seed into a cache, each a drive with its truth.

    python sample_scenes/generators/streets/make_streets.py --seeds 0-9 [--cache DIR] [--size small] [--only 3]

Needs Blender's Python module (``pip install bpy==5.0.1 OpenEXR opencv-contrib-python-headless``). Prints a seed's folder when it is there;
seeds that were rendered by the same generator are not rendered again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from sample_scenes.generators.streets import cache  # noqa: E402
from sample_scenes.generators.streets.draw import SIZES, draw  # noqa: E402


def seeds_of(text: str) -> list[int]:
    """``0-9``, ``3`` or ``0-4,7``."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def preview(seed: int, size: str, frames: list[int], folder: Path) -> None:
    """Render single crowded frames as PNG."""
    import cv2

    from sample_scenes.generators.streets import exposure
    from sample_scenes.generators.streets.build import build
    from sample_scenes.generators.streets.cameras import shots
    from sample_scenes.generators.streets.capture import Stage, view_of
    from sample_scenes.generators.streets.render import Studio

    plan = draw(seed, size)
    scene, objects = build(plan)
    everything = shots(plan)
    with tempfile.TemporaryDirectory() as scratch:
        studio, stage = Studio(scene, Path(scratch)), Stage(plan, objects)
        for frame in frames:
            stage.at(everything[frame].time)
            light = studio.take(view_of(plan, everything[frame]), frame + 1).light
            gain = exposure.base_gain([light], plan.light.brightness)
            cv2.imwrite(str(folder / f"preview_{seed:04d}_{frame:02d}.png"), exposure.encode(light, gain)[..., ::-1])


def make(seed: int, folder: Path | None, size: str) -> tuple[Path, float]:
    """The folder of a seed's drive, rendered if it is not there, and the seconds that took."""
    place, begun = cache.street_folder(seed, folder, size), time.perf_counter()

    def render(into: Path) -> None:
        from sample_scenes.generators.streets.capture import write_street

        write_street(draw(seed, size), into)

    rendered = cache.kept(place, render)
    return place, time.perf_counter() - begun if rendered else 0.0


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds_of, required=True, help="as 0-9 or 0-4,7")
    parser.add_argument("--cache", type=Path, default=None, help=f"where they are kept; {cache.DEFAULT} by default")
    parser.add_argument("--size", choices=[s for s in SIZES if s != "large"], default="usual", help="of the images, and how many")
    parser.add_argument("--only", type=int, nargs="*", help="render just these crowded frames, as PNG, and stop")
    parser.add_argument("-o", "--output", type=Path, default=Path.cwd(), help="where --only writes")
    arguments = parser.parse_args()
    for seed in arguments.seeds:
        if arguments.only:
            preview(seed, arguments.size, arguments.only, arguments.output)
            continue
        place, seconds = make(seed, arguments.cache, arguments.size)
        print(f"{seed} {place} {seconds:.0f} s", flush=True)


if __name__ == "__main__":
    main()
