"""Make the second truth scene: a country road uphill, with vegetation and little texture, crowded and empty.

Run with Blender's Python module (``pip install bpy==5.0.1 OpenEXR opencv-contrib-python-headless``):

    python sample_scenes/generators/country_road/make_road.py [--frames 28] [--samples 48] [--only 3] [--free] [-o FOLDER]

The layout is that of the parked street beside it, whose tools it uses.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / HERE.name
sys.path.insert(0, str(HERE))
import build_road  # noqa: E402  (also makes the street's tools importable)
import capture  # noqa: E402
import command_line  # noqa: E402

OFFSET = np.array([618_340.0, 5_337_120.0, 512.0])


if __name__ == "__main__":
    capture.STEP, capture.PITCH, capture.FINEST_CELL = 1.6, math.radians(1.0), 0.22
    command_line.command(__doc__, lambda: build_road.build(seed=11), OFFSET, samples=48, folder=DATA)
