"""New ground takes the place of what the reconstruction put where no view saw the ground; what stands keeps its foot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from tests.ground.test_street import UP, drive_on_circle
from tests.inpaint.sunny_street import CAR, TEXEL, box_surfels, sunny_chart
from unveil_core.base.srgb import relight
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, StreetChart
from unveil_core.inpaint.frames.holes import FrameTask, background_layers
from unveil_core.inpaint.frames.new_ground import displaced_by, ground_relit, new_ground, seed_ground
from unveil_core.inpaint.light.relight import relighting_gain
from unveil_core.raster.picture import picture_of
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels, concatenate, rotations

ROAD, HOUSE = 0, 1


def parked_chart() -> StreetChart:
    """What lies under the car is invented, all else was seen."""
    chart, *_ = sunny_chart(None)
    s, t = chart.coordinates()
    under = ((s > CAR[0, 0]) & (s < CAR[1, 0]))[:, None] & ((t > CAR[0, 1]) & (t < CAR[1, 1]))[None]
    return replace(chart, source=np.where(under, INVENTED, OBSERVED).astype(np.uint8))


def discs(places: list[tuple[float, float, float]], label: int) -> Surfels:
    """Surfels that lie flat."""
    points, count = np.array(places), len(places)
    return surfels_from_points(
        points,
        np.full((count, 3), 20, np.uint8),
        np.full(count, label),
        np.repeat(UP[None], count, 0),
        np.full(count, 0.2),
    )


def test_the_dark_under_a_car_goes_and_a_house_over_it_stays() -> None:
    chart = parked_chart()
    under, beside = (11.0, -2.5), (11.0, 1.0)
    region = new_ground(chart, np.array([[*under, 0.5]]), [], [])
    assert region.any() and not region[chart.source != INVENTED].any()
    surfels = concatenate([discs([(*under, 0.0), (*under, 0.7), (*beside, 0.0)], ROAD), discs([(*under, 3.0)], HOUSE)])
    assert displaced_by(chart, region, surfels, [ROAD]).tolist() == [True, True, False, False]
    far = new_ground(chart, np.array([[25.0, 4.0, 0.5]]), [], [])
    assert not far.any() and not displaced_by(chart, far, surfels, [ROAD]).any()
    close = drive_on_circle(np.inf, 0.0)[4].resized(2400, 1600)
    seeds = seed_ground(chart, region, [close], spacing=0.1, sh_degree=0, default_label=ROAD)
    # They cover all that was taken away.
    assert len(seeds) > 100 and np.abs(seeds.means[:, :2] - torch.tensor(under)).norm(dim=1).min() < 0.1


def test_ground_seen_from_afar_has_longer_surfels_in_the_same_colours() -> None:
    """Across the street they stay as close; along it they follow the street, and cover it as before."""
    chart = parked_chart()
    stripes = np.where(np.arange(chart.color.shape[1]) % 16 < 8, 0.2, 0.7).astype(np.float32)
    color = np.broadcast_to(stripes[None, :, None], chart.color.shape).copy()
    chart = replace(chart, color=color, source=np.where(chart.source == OUTSIDE, OUTSIDE, INVENTED).astype(np.uint8))
    here, sky = drive_on_circle(np.inf, 0.0, frames=1)[0], Sky(torch.full((3, 8, 16), 0.5), np.eye(3))
    small = here.resized(60, 40)
    s, t = chart.coordinates()
    street = ((s > 8) & (s < 24))[:, None] & (np.abs(t) < 3)
    fine, long = (
        seed_ground(chart, street, [camera], spacing=0.1, sh_degree=0, default_label=ROAD)
        for camera in (here.resized(38400, 25600), small)
    )
    assert len(long) < 0.3 * len(fine)
    scales = [surfels.log_scales.exp().numpy() for surfels in (fine, long)]
    assert np.isclose(*(float(scale.prod(axis=1).sum()) for scale in scales), rtol=1e-3)
    assert np.allclose(scales[0], scales[1].min()) and np.isclose(scales[1].max() / scales[1].min(), 4)
    assert np.abs(rotations(long.quats)[:, :, 0].numpy() @ [1, 0, 0] - 1).max() < 1e-3
    shown = [picture_of(one, sky, small, near=0.2, far=100.0).astype(float) for one in (fine, long)]
    assert np.abs(shown[0] - shown[1]).mean() < 1.0 < shown[0].std()


def test_only_the_ground_is_relit() -> None:
    chart = parked_chart()
    gain = chart.gain.copy()
    gain[:, : gain.shape[1] // 2] = 1.5
    surfels = discs([(11.0, -2.5, 0.05), (11.0, -2.5, 1.0), (11.0, 2.5, 0.05)], ROAD)
    assert ground_relit(replace(chart, gain=gain), surfels).tolist() == [True, False, False]


def test_a_bush_goes_down_to_its_foot_and_what_a_car_left_does_not() -> None:
    """A box on the ground: of a bush it is seen down to its foot; of the ground, it is what a car's underside left there."""
    chart = parked_chart()
    camera = drive_on_circle(np.inf, 0.0)[0].resized(192, 128)
    box = box_surfels(np.array([[9.0, -3.0, 0.0], [10.0, -1.0, 0.4]]))
    whole = replace(chart, source=np.where(chart.source == OUTSIDE, OUTSIDE, INVENTED).astype(np.uint8))
    layer = GroundLayer(whole, ground_labels=(ROAD,))
    everything = np.ones((camera.height, camera.width), bool)
    task = FrameTask(camera, np.zeros((*everything.shape, 3), np.uint8), everything, everything)
    street = seed_ground(whole, np.ones_like(whole.source, bool), [], spacing=0.1, sh_degree=0, default_label=ROAD)
    shown = []
    for label in (ROAD, HOUSE):
        scene = concatenate([street, replace(box, labels=torch.full_like(box.labels, label))])
        shown.append(background_layers(task, scene, layer).in_front)
    pixel, _ = camera.project(np.array([[9.0, -1.8, 0.2], [9.0, -1.8, 0.12], [9.0, -1.8, 0.35], [9.0, 0.5, 0.0]]))
    x, y = pixel.astype(int).T
    assert shown[1][y, x].tolist() == [True, True, True, False]
    assert not shown[0][y, x].any()


def test_a_narrow_shadow_with_its_penumbra_is_taken_away_in_all_colours() -> None:
    """Sun and sky have other colours, and a penumbra has some of both: its mixture must not leave an outline."""
    per_m = 1 / TEXEL
    lit, left = np.array([0.52, 0.54, 0.58]), np.array([0.33, 0.4, 0.49])
    across = np.abs(np.arange(120) - 60) * TEXEL
    share = np.clip((0.6 - across) / 0.3 + 0.5, 0, 1)[None, :, None].repeat(200, 0)
    color = (lit * (1 - share * (1 - left))).astype(np.float32)
    seen, shadow = np.ones((200, 120), bool), share[..., 0] > 0.5
    wide = share[..., 0] > 0.2
    target = np.broadcast_to(lit, color.shape).astype(np.float32)
    gain = relighting_gain(color, target, seen, shadow, wide, shadow, per_m=per_m)
    error = (relight(color, gain) / lit - 1)[40:-40]
    assert np.abs(error[:, across < 0.4]).max() < 0.03
    assert np.abs(error).max() < 0.07
