"""Make the sample drive: a small curving street with parked cars, photographed twice, crowded and empty.

Run with Blender's Python module (``pip install bpy==5.0.1 OpenEXR opencv-contrib-python-headless``):

    python sample_scenes/generators/parked_street/make_street.py [--frames 28] [--samples 64] [--only 3] [--free] [-o FOLDER]

Writes transforms.json, images/, semantics/, instances/, points.ply and truth/ in the layout that Unveil reads; by default into
sample_scenes/parked_street.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / HERE.name
sys.path.insert(0, str(HERE))
import build_street  # noqa: E402
import command_line  # noqa: E402

UTM = np.array([352_140.0, 5_812_960.0, 34.0])
"""Where the street stands in the world: large coordinates, as surveyed drives have them."""


if __name__ == "__main__":
    command_line.command(__doc__, lambda: build_street.build(seed=7), UTM, samples=64, folder=DATA)
    bpy.ops.wm.quit_blender() if bpy.app.binary_path else None
