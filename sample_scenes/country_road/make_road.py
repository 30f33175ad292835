"""Make the second truth scene: a country road uphill, with vegetation and little texture, crowded and empty.

Run with Blender's Python module (``pip install bpy==5.0.1 OpenEXR opencv-contrib-python-headless``):

    python make_road.py [--frames 28] [--samples 48] [--only 3] [-o FOLDER]

The layout is that of the parked street beside it, whose tools it uses.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import build_road  # noqa: E402  (also makes the street's tools importable)
import capture  # noqa: E402

OFFSET = np.array([618_340.0, 5_337_120.0, 512.0])


def main() -> None:
    """Build, render crowded and empty, cast the LiDAR, derive masks, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=28)
    parser.add_argument("--samples", type=int, default=48)
    parser.add_argument("--only", type=int, nargs="*", help="render just these frames, as PNG, and stop")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent)
    arguments = parser.parse_args(sys.argv[1:])
    scene = build_road.build(seed=11)
    capture.STEP, capture.PITCH, capture.FINEST_CELL = 1.6, math.radians(1.0), 0.22
    capture.configure(scene, samples=arguments.samples)
    cameras = capture.drive(scene, frames=arguments.frames)
    if arguments.only:
        for frame in arguments.only:
            capture.render_color(scene, cameras, frame, arguments.output / f"preview_{frame:04d}.png")
        return
    capture.write_drive(scene, cameras, arguments.output, OFFSET)
    print(json.dumps({"frames": arguments.frames, "objects": len(build_road.street.removable(scene))}))


if __name__ == "__main__":
    main()
