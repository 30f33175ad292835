"""The sun found by its shadows, the shadows that it casts, and the ground filled in its light."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from tests.inpaint.sunny_street import CAR, CROWN, HOUSE, ROW, SHADE, blocked, box_surfels, sunny_chart
from unveil_core.base.srgb import relight
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, RELIT, StreetChart
from unveil_core.inpaint.fill.chart_fill import fill_chart
from unveil_core.inpaint.light import sun_by_shadows
from unveil_core.inpaint.light.casters import NO_KINDS, lit_at_sunny_walls
from unveil_core.inpaint.light.darkness import in_the_dark
from unveil_core.inpaint.light.houses import as_high_as_beside, flush_with_facades, of_something_long, solid_columns
from unveil_core.inpaint.light.scene_light import Evidence, light_of_scene, sun_of_scene
from unveil_core.inpaint.light.shade import Light, read_shade, shade_where_unseen
from unveil_core.inpaint.light.shadow_map import Discs, in_shadow
from unveil_core.inpaint.light.sun import Sun, sun_towards
from unveil_core.surfels.surfels import Surfels, concatenate

UP = np.array([0.0, 0.0, 1.0])


def found_light(chart: StreetChart, kept: Surfels, gone: Surfels) -> Light | None:
    """The light by the sun that is found, None where none is."""
    evidence = Evidence(chart)
    sun = sun_of_scene(evidence, kept, gone)
    return None if sun is None else light_of_scene(evidence, kept, gone, NO_KINDS, sun)


@cache
def lit_street(sun: tuple[float, float]) -> tuple[StreetChart, np.ndarray, np.ndarray, Light]:
    """Chart, truth and footprint of a sunny street, and the light found on it."""
    chart, truth, footprint, kept, car = sunny_chart(sun_towards(*sun))
    light = found_light(chart, kept, car)
    assert light is not None
    return chart, truth, footprint, light


SUNS = [(150.0, 40.0), (200.0, 55.0)]


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def test_azimuth_runs_as_on_a_compass() -> None:
    assert np.allclose(sun_towards(0, 0), [0, 1, 0])
    assert np.allclose(sun_towards(90, 0), [1, 0, 0], atol=1e-12)
    assert np.allclose(sun_towards(17, 90), [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("sun", SUNS[:1])
def test_casters_that_are_too_large_do_not_turn_the_sun(
    sun: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    chart, *_ = sunny_chart(sun_towards(*sun))
    more = np.array([[-0.18], [0.18]])
    kept = concatenate([box_surfels(box + more, spacing=0.2) for box in (CROWN, HOUSE)])
    off = []
    for margins in (sun_by_shadows.MARGINS_M, (0.0,)):
        monkeypatch.setattr(sun_by_shadows, "MARGINS_M", margins)
        light = found_light(chart, kept, box_surfels(CAR + more, spacing=0.2))
        assert light is not None
        off.append(angle(light.sun.towards, sun_towards(*sun)))
    assert off[0] < 2.5 and off[0] < off[1]


@pytest.mark.parametrize("sun", SUNS)
def test_shadows_fall_where_rays_to_the_sun_are_blocked(sun: tuple[float, float]) -> None:
    towards = sun_towards(*sun)
    x, y = np.meshgrid(np.arange(0, 25, 0.1), np.arange(-8, 8, 0.1), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    found = in_shadow(points, Discs.of(box_surfels(CROWN)), towards).reshape(x.shape)
    true = blocked(points, CROWN, towards).reshape(x.shape)
    # Discs reach a few centimetres over the box's edges.
    border = cv2.morphologyEx(true.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8)) > 0
    assert true.sum() > 100
    assert np.array_equal(found[~border], true[~border])


def test_faint_surfels_and_none_cast_nothing() -> None:
    points = np.zeros((4, 3))
    towards = np.array([0.0, 0.0, 1.0])
    crown = box_surfels(np.array([[-1.0, -1.0, 2.0], [1.0, 1.0, 3.0]]))
    assert in_shadow(points, Discs.of(crown), towards).all()
    faint = type(crown)(
        crown.means, crown.quats, crown.log_scales, crown.opacity_logits * 0 - 5, crown.sh, crown.labels
    )
    assert not in_shadow(points, Discs.of(faint), towards).any()
    assert not in_shadow(points, Discs.of(crown.select(crown.labels > 5)), towards).any()


@pytest.mark.parametrize("sun", SUNS)
def test_the_sun_is_found_by_its_shadows(sun: tuple[float, float]) -> None:
    light = lit_street(sun)[-1]
    # 3 degrees move the shadow of a crown by half its own blur.
    assert angle(light.sun.towards, sun_towards(*sun)) < 3.0


def test_places_tell_of_the_sun_by_the_border_of_the_shade() -> None:
    """Each metre off the border less, and alike on either side; where there is no border all tell the same."""
    s, t = (p.ravel() for p in np.meshgrid(np.arange(0, 20, 0.2), np.arange(0, 4, 0.2), indexing="ij"))
    places, is_dark = np.column_stack([s, t, np.zeros(len(s))]), s < 10
    worth = sun_by_shadows._worth(places, is_dark)
    order = np.argsort(np.abs(s - 9.9), kind="stable")
    assert (np.diff(worth[order]) < 1e-9).all()
    assert worth[order[0]] > 0.6 and worth[order[-1]] < 0.06
    assert np.allclose(worth[is_dark].sum(), worth[~is_dark].sum())
    assert np.ptp(sun_by_shadows._worth(places, np.ones(len(s), dtype=bool))) == 0


def test_a_street_in_the_shade_of_its_houses_all_along_tells_where_the_sun_stands() -> None:
    """Half of the road and one sidewalk have no ray of sun anywhere: their offsets are all dark, and the same all along."""
    towards = sun_towards(*SUNS[0])
    chart, truth, footprint, kept, car = sunny_chart(towards, ROW)
    dark = in_the_dark(chart, chart.source == OBSERVED)
    assert dark.all(axis=0).sum() > 20, "offsets that are in shade wherever they were seen"
    light = found_light(chart, kept, car)
    assert light is not None and angle(light.sun.towards, towards) < 5.0
    result = fill_chart(chart, footprint, light=light)
    hole = (chart.source == OUTSIDE) & (result.source == INVENTED)
    assert np.square(result.color - truth)[hole].mean() < 0.1 * truth[hole].var(axis=0).mean()


def test_an_overcast_street_has_no_sun() -> None:
    chart, *_, kept, car = sunny_chart(None)
    assert found_light(chart, kept, car) is None


def test_one_black_spot_is_no_shadow() -> None:
    """A square metre of tar on an overcast street: there is a direction from which the shadow of a lamp would lie there."""
    chart, *_, kept, car = sunny_chart(None)
    color, per_m = chart.color.copy(), round(1 / chart.texel)
    color[10 * per_m : 11 * per_m, 9 * per_m : 10 * per_m] *= 0.15
    lamp = box_surfels(np.array([[7.5, -1.0, 2.5], [8.5, 0.0, 3.5]]))
    assert found_light(replace(chart, color=color), lamp, car) is None


@pytest.mark.parametrize("sun", SUNS)
def test_shadows_that_nothing_seen_casts_are_no_sun(sun: tuple[float, float]) -> None:
    """What shades the street was not seen, but a low wall beside it was: some direction always explains some of what is dark."""
    chart, *_, car = sunny_chart(sun_towards(*sun))
    wall = box_surfels(np.array([[0.0, 6.0, 0.0], [25.0, 6.5, 3.0]]))
    assert found_light(chart, wall, car) is None


def test_asphalt_of_two_ages_that_lies_like_shadows_is_no_sun() -> None:
    """Patches a seventh darker than the rest, exactly where a sun would cast the shadows: light falls by half in those."""
    chart, *_, kept, car = sunny_chart(sun_towards(*SUNS[0]))
    even = sunny_chart(None)[0]
    shaded = chart.color.sum(axis=2) < 0.8 * even.color.sum(axis=2)
    assert 0.05 < shaded.mean() < 0.5
    patched = replace(even, color=np.where(shaded[..., None], 0.86 * even.color, even.color).astype(np.float32))
    assert found_light(patched, kept, car) is None
    assert found_light(chart, kept, car) is not None


def test_shade_is_read_with_its_ratio() -> None:
    chart, _, _, light = lit_street(SUNS[0])
    seen = chart.source == OBSERVED

    def profile(color: np.ndarray, usable: np.ndarray) -> np.ndarray:
        return np.repeat(np.nanmedian(np.where(usable[..., None], color, np.nan), axis=0)[None], len(color), axis=0)

    shade = read_shade(chart.color, seen, light.kept | light.gone, profile, texels_per_m=20.0)
    assert np.abs(shade.ratio - SHADE).max() < 0.03


@pytest.mark.parametrize("sun", SUNS)
def test_what_is_invented_lies_in_the_sun_or_in_the_shadow_of_what_stays(sun: tuple[float, float]) -> None:
    chart, truth, footprint, light = lit_street(sun)
    lit, blind = (fill_chart(chart, footprint, light=given) for given in (light, None))
    hole = (chart.source == OUTSIDE) & (lit.source == INVENTED)
    assert hole.sum() > 5_000

    def error(color: np.ndarray) -> float:
        return float(np.square(color - truth)[hole].mean())

    assert error(lit.color) < 0.5 * error(blind.color)
    # Nine tenths of what the ground there varies, and sun and shade nearly everywhere.
    assert error(lit.color) < 0.1 * truth[hole].var(axis=0).mean()
    dark = [c[hole].mean(axis=1) < 0.36 for c in (truth, lit.color)]
    assert (dark[0] == dark[1]).mean() > 0.95


def test_the_cars_shadow_goes_and_the_crowns_stays() -> None:
    towards = sun_towards(*SUNS[0])
    chart, truth, footprint, light = lit_street(SUNS[0])
    result = fill_chart(chart, footprint, light=light)
    world = chart.world(*(i.ravel() for i in np.indices(chart.source.shape)))
    of_car, of_others = (
        np.any([blocked(world, b, towards) for b in boxes], axis=0).reshape(chart.source.shape)
        for boxes in ((CAR,), (CROWN, HOUSE))
    )
    seen = (chart.source == OBSERVED) & ~footprint
    inner = cv2.erode((of_car & ~of_others & seen).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert inner.sum() > 200
    assert (result.source[inner] == RELIT).mean() > 0.9
    assert np.abs(result.color - truth)[inner].mean() < 0.04
    stays = cv2.erode((of_others & ~of_car & seen).astype(np.uint8), np.ones((11, 11), np.uint8)) > 0
    assert stays.sum() > 200
    assert np.array_equal(result.color[stays], chart.color[stays])


def test_shadows_are_moved_to_where_they_are_seen_to_lie() -> None:
    """A house's shadow that is cast half a metre too far, and a crown's that is cast beside its place."""
    per_m = 20.0
    true, cast = np.zeros((800, 300), dtype=bool), np.zeros((800, 300), dtype=bool)
    true[:, :100], cast[:, :110] = True, True
    cv2.circle(dark := np.zeros((800, 300), np.uint8), (200, 400), 40, 1, -1)
    cv2.circle(wrong := np.zeros((800, 300), np.uint8), (192, 390), 40, 1, -1)
    true |= dark > 0
    cast |= wrong > 0
    sound = np.ones_like(true)
    for row in range(60, 760, 140):
        sound[row : row + 80, 60:140] = False
    sound[380:480, 200:260] = False
    light = Light(Sun(UP, 1.0, 0.0, 90.0), cast, np.zeros_like(cast))
    found = shade_where_unseen(light, sound, true & sound, texels_per_m=per_m)
    before = (cast != true)[~sound].sum()
    assert ((found > 0.5) != true)[~sound].sum() < 0.35 * before


def test_a_few_misread_texels_in_a_gap_throw_no_light_on_their_surroundings() -> None:
    per_m = 20.0
    cast = np.zeros((800, 300), dtype=bool)
    cast[:, :150] = True
    sound = np.zeros_like(cast)
    sound[:, 160:] = True
    sound[400:405, 100:105] = True
    light = Light(Sun(UP, 1.0, 0.0, 90.0), cast, np.zeros_like(cast))
    found = shade_where_unseen(light, sound, np.zeros_like(cast), texels_per_m=per_m)
    assert (found[:, :140] > 0.5).mean() > 0.99


def test_where_a_rows_shade_is_seen_to_end_it_ends_behind_a_lorry_too() -> None:
    """The houses' shade is cast 2.5 m too far, as by a sun that is taken for too low; a lorry hides 8 m of its border."""
    per_m = 20.0
    true, cast = np.zeros((500, 300), dtype=bool), np.zeros((500, 300), dtype=bool)
    true[:, :100], cast[:, :150] = True, True
    sound = np.ones_like(true)
    sound[200:360, 60:200] = False
    light = Light(Sun(UP, 1.0, 0.0, 90.0), cast, np.zeros_like(cast))
    found = shade_where_unseen(light, sound, true & sound, texels_per_m=per_m)
    assert ((found > 0.5) == true)[~sound].mean() > 0.92


def test_lamps_are_no_houses() -> None:
    wall = np.stack([np.arange(0, 30), np.full(30, 20)], axis=1)
    lamp = np.array([[10, 5], [11, 5]])
    assert of_something_long(np.concatenate([wall, lamp])).tolist() == [True] * 30 + [False] * 2
    assert not len(of_something_long(np.zeros((0, 2), dtype=np.int64)))


def test_a_house_that_the_picture_cuts_off_is_as_high_as_farther_along() -> None:
    chart = lit_street(SUNS[0])[0]
    cell = 0.3
    at = np.stack([np.arange(0, 18, cell), np.full(60, 6.0)], axis=1)
    pose = np.array([[0.0, -1, 0, 0], [0, 0, -1, 1.5], [1, 0, 0, 0], [0, 0, 0, 1]])
    camera = Camera(384, 256, 274.0, 274.0, 192.0, 128.0, pose)
    seen = np.minimum(7.0, 1.5 + 0.46 * at[:, 0])  # what the border leaves of a wall seven metres high
    top = as_high_as_beside(chart, at, seen, [camera])
    near = (seen > 3.5) & (seen < 6.5)  # within ten metres of where its top is seen
    assert near.sum() > 10 and np.allclose(top[near], 7.0, atol=0.1)
    assert np.allclose(top[seen == 7.0], 7.0)
    assert np.array_equal(as_high_as_beside(chart, at, seen, []), seen)


def test_what_floats_before_a_facade_is_not_of_the_house() -> None:
    chart, *_ = lit_street(SUNS[0])
    house = box_surfels(HOUSE, spacing=0.2)
    stray = box_surfels(np.array([[18.0, -7.5, 5.0], [18.6, -7.0, 5.6]]), spacing=0.2)
    both = concatenate([house, stray])
    kept = flush_with_facades(chart, both, [0])
    assert kept[: len(house)].all() and not kept[len(house) :].any()
    assert flush_with_facades(chart, both, [3]).all(), "only of what is solid"


def test_the_house_that_nobody_saw_is_as_high_as_its_shadow_says() -> None:
    """Of the houses that may follow, the one that darkens what is dark and leaves light what is light."""
    chart, *_ = lit_street(SUNS[0])
    house = box_surfels(HOUSE, spacing=0.2)
    top_seen = []

    def judge(added: Surfels) -> float:
        means = added.means.double().numpy()
        before = means[means[:, 0] < HOUSE[0, 0] - 3.5, 2]
        top_seen.append(float(before.max()) if len(before) else 0.0)
        return -abs(top_seen[-1] - 10.0)  # as if the ground told of ten metres

    columns = solid_columns(chart, house, [0], [], judge)
    means = columns.means.double().numpy()
    assert abs(means[means[:, 0] < HOUSE[0, 0] - 5.0, 2].max() - 10.0) < 0.7
    assert len(set(np.round(top_seen, 1))) > 5, "several heights were tried"
    plain = solid_columns(chart, house, [0], []).means.double().numpy()
    assert abs(plain[plain[:, 0] < HOUSE[0, 0] - 5.0, 2].max() - HOUSE[1, 2]) < 0.7, "as high as the others"


def test_a_wall_that_the_sun_shines_on_does_not_shade_its_own_foot() -> None:
    """The sun stands on the right: along the left border lies a rough wall's shadow, and that of a tree that reaches farther."""
    chart, *_ = sunny_chart(None)
    towards = np.array([0.0, -0.6, 0.8])
    rows, columns = chart.source.shape
    inside = np.zeros((rows, columns), dtype=bool)
    inside[:, 10 : columns - 10] = True
    rough, tree, house = (np.zeros_like(inside) for _ in range(3))
    rough[:, columns - 15 : columns - 10] = True
    tree[200:260, columns - 60 : columns - 10] = True
    house[:, 10:14] = True
    lit = lit_at_sunny_walls(chart, rough | tree | house, inside, towards, 12)
    assert np.array_equal(lit, tree | house)
    mirrored = lit_at_sunny_walls(chart, rough | tree | house, inside, towards * [1, -1, 1], 12)
    assert np.array_equal(mirrored, rough | tree)


def test_invented_ground_is_as_bright_as_the_ground_around_it() -> None:
    """Under an even sky, on asphalt of two ages: the darker half begins beside the car, and lateral offsets have both."""
    chart, truth, footprint, *_ = sunny_chart(None)
    s = chart.coordinates()[0]
    age = np.where(s < 11.25, 0.8, 1.0).astype(np.float32)[:, None, None]
    aged = replace(chart, color=chart.color * age)
    filled = fill_chart(aged, footprint, light=None)
    hidden = filled.source == INVENTED
    wrong = (filled.color - truth * age)[hidden].mean(axis=1)
    assert hidden.sum() > 1000
    assert np.abs(wrong).mean() < 0.03
    old, new = (
        (filled.color / np.maximum(truth, 0.02))[hidden & (half[:, None])].mean() for half in (s < 10.5, s > 12.5)
    )
    assert old < 0.88 < 0.95 < new


def test_where_houses_shade_most_of_a_street_what_nobody_saw_lies_in_shade() -> None:
    """No sun is known; at the car's lateral offsets it shines wherever anything was seen, but for what is seen beside the car."""
    chart, truth, footprint, *_ = sunny_chart(None)
    shade = np.array([0.13, 0.18, 0.3], np.float32)
    s, t = chart.coordinates()
    of_car = footprint.any(axis=0) & ~footprint.all(axis=0)
    at = np.flatnonzero(footprint.any(axis=1))
    lit = np.zeros_like(footprint)
    lit[:, of_car] = True
    lit[max(0, at[0] - 60) : at[-1] + 60] = False
    dark = replace(chart, color=np.where(lit[..., None], chart.color, relight(chart.color, shade)).astype(np.float32))
    filled = fill_chart(dark, footprint, light=None)
    wrong = (filled.color - relight(truth, shade))[(filled.source == INVENTED) & footprint].mean(axis=1)
    assert len(wrong) > 1000
    assert np.abs(wrong).mean() < 0.04


def test_a_cast_shadow_whose_seen_part_lies_in_the_sun_is_not_drawn_where_nobody_saw() -> None:
    per_m = 25.0
    sound = np.ones((400, 200), dtype=bool)
    sound[:, 100:] = False
    floating, house = np.zeros((2, *sound.shape), dtype=bool)
    floating[80:130, 85:150] = True  # of surfels that hang where an object went
    house[250:350, 60:160] = True
    found = shade_where_unseen(
        Light(sun_towards(180, 45), floating | house, np.zeros_like(house)), sound, house & sound, texels_per_m=per_m
    )
    assert found[floating & ~sound].max() < 0.1
    assert found[265:335, 100:145].min() > 0.9
