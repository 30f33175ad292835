"""Relighting takes shadows from the ground, and leaves what stands on it alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from tests.ground.test_street import drive_on_circle
from tests.inpaint.sunny_street import TEXEL, sunny_chart
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.chart.street_chart import INVENTED
from unveil_core.inpaint.frames.holes import FrameTask
from unveil_core.inpaint.frames.new_ground import seed_ground
from unveil_core.inpaint.frames.propagate import Painted, RemainingScene, propagate_inpainting
from unveil_core.inpaint.light.relight import OBJECT_M, sky_gain
from unveil_core.surfels.sky import Sky


def test_no_light_is_thrown_on_what_stays() -> None:
    chart, *_ = sunny_chart(None)
    gain = chart.gain.copy()
    gain[int(7 / TEXEL) : int(14 / TEXEL), int(5 / TEXEL) : int(9 / TEXEL)] = 1.5
    whole = replace(chart, gain=gain, source=np.full_like(chart.source, INVENTED))
    camera = drive_on_circle(np.inf, 0.0)[0].resized(108, 72)
    street = seed_ground(whole, np.ones(gain.shape[:2], bool), [], spacing=0.15, sh_degree=0, default_label=0)
    layer = GroundLayer(whole)
    nothing, picture = np.zeros((72, 108), bool), np.full((72, 108, 3), 100, np.uint8)
    car = nothing.copy()
    car[:, :54] = True
    cleaned = []
    for kept in (None, car):
        task = FrameTask(camera, picture, nothing, nothing, kept)
        sky = Sky(torch.zeros(3, 8, 16), np.eye(3))
        scene = RemainingScene(street, sky, layer, 1)
        done: dict[int, Painted] = {}
        propagate_inpainting([task], scene, lambda image, _: image, done.setdefault, plan=None)  # type: ignore[arg-type]
        cleaned.append((done[0].image != 100).any(axis=2))
    assert (cleaned[0] & car).sum() > 50
    assert not (cleaned[1] & car).any()
    assert (cleaned[1][:, 54:] == cleaned[0][:, 54:]).all()


def test_an_even_sky_gives_back_what_a_long_wall_hid() -> None:
    """Against the view factor of a wall, by integration over the hemisphere."""
    per_m = 20
    footprint = np.zeros((10, 201), dtype=bool)
    footprint[:, :100] = True
    gain = sky_gain(footprint, per_m)
    assert np.isinf(gain[:, :100]).all()
    assert (np.diff(gain[5, 100:]) < 0).all()
    for column in (110, 130, 160):
        distance = (column - 99) / per_m
        # Elevation over the wall's edge, across the wall's direction: light from there falls on the ground by its sine.
        across = np.linspace(0, np.pi, 20_001)
        hidden = across < np.arctan2(OBJECT_M, distance)
        lost = np.sin(across[hidden]).sum() / np.sin(across).sum()
        assert abs(1 / gain[5, column] - (1 - lost)) < 0.02
