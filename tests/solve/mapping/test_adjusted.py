"""The lens at the end of a solve: its centre is free where the pictures tell of it."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from unveil_core.solve.mapping.process import CHILD
from unveil_core.solve.stages.mapping import CENTRE_GAIN, FREER, GAIN, LEAST_ANGLE_DEG, MOST_PX

pytest.importorskip("pycolmap")

MIDDLE = (621.0, 187.5)
SCRIPT = """
import importlib.util, json, sys
import pycolmap
spec = importlib.util.spec_from_file_location("child", sys.argv[1])
child = importlib.util.module_from_spec(spec)
spec.loader.exec_module(child)
given = json.loads(sys.argv[2])
pycolmap.logging.minloglevel = 3
pycolmap.set_random_seed(1)
options = pycolmap.SyntheticDatasetOptions()
options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 1, 1, 12, 300
options.camera_model_id = pycolmap.CameraModelId.SIMPLE_RADIAL
options.camera_width, options.camera_height = 1242, 375
options.camera_params = given["true"]
model = pycolmap.synthesize_dataset(options)
noise = pycolmap.SyntheticNoiseOptions()
noise.point2D_stddev = 0.3
pycolmap.synthesize_noise(noise, model)
model.cameras[1].params = given["first"]
class Teller:
    def progress(self, *told): pass
found, told = child._adjusted(model, given["request"], Teller())
print(json.dumps([list(found.cameras[1].params), told]))
"""
"""pycolmap does not share a process with OpenCV."""


def adjusted(centre: tuple[float, float]) -> tuple[list[float], list[Any]]:
    """The lens that is found of pictures whose centre is elsewhere than in their middle, and what was tried."""
    request = {
        "refine_focal": True,
        "threads": 1,
        "most_px": MOST_PX,
        "least_angle": LEAST_ANGLE_DEG,
        "always_bent": False,
    }
    request |= {"lenses": FREER, "gain": GAIN, "centre_gain": CENTRE_GAIN}
    given = {"true": [720.0, *centre, 0.0], "first": [700.0, *MIDDLE, 0.0], "request": request}
    done = subprocess.run(
        [sys.executable, "-P", "-c", SCRIPT, str(CHILD), json.dumps(given)], capture_output=True, text=True, check=True
    )
    parameters, told = json.loads(done.stdout.splitlines()[-1])
    return parameters, told


@pytest.mark.parametrize("centre", [(610.0, 173.0), (618.0, 184.0)])
def test_a_centre_that_is_not_in_the_middle_is_found(centre: tuple[float, float]) -> None:
    """The second one lowers the error by less than 1 %."""
    parameters, told = adjusted(centre)
    assert parameters[1:3] == pytest.approx(centre, abs=1.0) and any(taken for _, free, _, taken in told if free)


def test_a_centre_in_the_middle_stays_there() -> None:
    parameters, told = adjusted(MIDDLE)
    assert tuple(parameters[1:3]) == MIDDLE and not any(taken for _, _, _, taken in told)
    assert parameters[0] == pytest.approx(720.0, rel=0.005)
