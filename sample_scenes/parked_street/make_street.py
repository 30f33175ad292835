"""Make the sample drive: a small curving street with parked cars, photographed twice, crowded and empty.

Run with Blender's Python module (``pip install bpy==5.0.1 OpenEXR opencv-contrib-python-headless``):

    python make_street.py [--frames 28] [--samples 64] [--only 3] [-o FOLDER]

Writes transforms.json, images/, semantics/, instances/, points.ply and truth/ in the layout that Unveil reads.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import build_street  # noqa: E402
import capture  # noqa: E402

UTM = np.array([352_140.0, 5_812_960.0, 34.0])
"""Where the street stands in the world: large coordinates, as surveyed drives have them."""


def main() -> None:
    """Build, render crowded and empty, cast the LiDAR, derive masks, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=28)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--only", type=int, nargs="*", help="render just these frames, as PNG, and stop")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent)
    arguments = parser.parse_args(sys.argv[1:])
    scene = build_street.build(seed=7)
    capture.configure(scene, samples=arguments.samples)
    cameras = capture.drive(scene, frames=arguments.frames)
    if arguments.only:
        for frame in arguments.only:
            capture.render_color(scene, cameras, frame, arguments.output / f"preview_{frame:04d}.png")
        return
    capture.write_drive(scene, cameras, arguments.output, UTM)
    print(json.dumps({"frames": arguments.frames, "objects": len(build_street.removable(scene))}))


if __name__ == "__main__":
    main()
    bpy.ops.wm.quit_blender() if bpy.app.binary_path else None
