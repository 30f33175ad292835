"""Which frames become keyframes, on holes whose size and neighbours are known exactly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.inpaint.walls import before_wall, hole_of, shows
from unveil_core.base.frame_cache import Frames
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.inpaint.frames.holes import Hole
from unveil_core.inpaint.frames.keyframes import carried, plan_keyframes, sharper_elsewhere

A, B, C = (-2.0, -1.0, -0.5, 0.5), (-0.5, 0.5, -0.5, 0.5), (1.0, 2.0, -0.5, 0.5)


def chosen(plan) -> list[int]:  # type: ignore[no-untyped-def]
    return [k.frame for k in plan.keyframes]


def test_the_frame_that_shows_most_is_enough() -> None:
    cameras = [before_wall(x, 5.0) for x in (-0.3, 0.0, 0.3)]
    holes = [hole_of(cameras[0], A), hole_of(cameras[1], A, B, C), hole_of(cameras[2], C)]
    plan = plan_keyframes(holes, [0, 1, 2])
    assert chosen(plan) == [1]
    (key,) = plan.keyframes
    assert key.pixels == holes[1].mask.sum() and not key.deferred.any()
    assert key.area == pytest.approx(3.0, rel=0.06)
    assert plan.remaining.sum() <= 0.02 * holes[1].mask.sum() and plan.visit_order == (2, 1, 0)


def test_what_one_frame_lacks_another_adds() -> None:
    cameras = [before_wall(x, 5.0) for x in (-0.3, 0.0, 0.3)]
    holes = [hole_of(cameras[0], A), hole_of(cameras[1], A, B), hole_of(cameras[2], B, C)]
    plan = plan_keyframes(holes, [0, 1, 2])
    assert chosen(plan) == [2, 1]
    assert [k.area for k in plan.keyframes] == pytest.approx([2.0, 1.0], rel=0.1)


@pytest.mark.parametrize(("order", "first"), [("reverse", 3), ("forward", 0)])
def test_equals_go_to_the_frame_met_first(order: str, first: int) -> None:
    holes = [hole_of(before_wall(0.1 * i, 5.0 - 0.05 * i), B) for i in range(4)]
    assert chosen(plan_keyframes(holes, range(4), order=order)) == [first]


def test_a_much_sharper_view_wins_though_it_is_earlier() -> None:
    """A camera that drives away: forward and reversed time disagree."""
    holes = [hole_of(before_wall(0.0, 3.0 + 2 * i), B) for i in range(4)]
    plan = plan_keyframes(holes, range(4))
    assert chosen(plan) == [0]
    assert plan.remaining.sum() == 0


def test_a_place_is_deferred_to_the_view_that_sees_it_much_sharper() -> None:
    far, near = hole_of(before_wall(0.0, 8.0), A, B), hole_of(before_wall(0.0, 2.5), B)
    plan = plan_keyframes([near, far], [0, 1])
    assert chosen(plan) == [1, 0]
    assert np.array_equal(plan.keyframes[0].deferred, shows(far.camera, B))
    assert [k.area for k in plan.keyframes] == pytest.approx([1.0, 1.0], rel=0.15)
    assert chosen(plan_keyframes([near, far], [0, 1], order="forward")) == [1]


def test_given_keyframes_are_kept_and_no_others_taken() -> None:
    holes = [hole_of(before_wall(0.1 * i, 5.0), A, B, C) for i in range(4)]
    plan = plan_keyframes(holes, range(4), given=(0, 2))
    assert chosen(plan) == [2, 0]
    assert plan.keyframes[0].pixels == holes[2].mask.sum() and plan.keyframes[1].pixels < 60
    nothing = [*holes[:3], hole_of(before_wall(0.3, 5.0))]
    assert chosen(plan_keyframes(nothing, range(4), given=(3,))) == [3]
    assert plan_keyframes(nothing, range(4), given=(3,)).remaining.tolist() == [int(h.mask.sum()) for h in nothing]


def test_two_cameras_of_a_rig_need_one_keyframe() -> None:
    left = [hole_of(before_wall(-0.2 + 0.1 * i, 5.0), B) for i in range(3)]
    right = [hole_of(before_wall(0.2 + 0.1 * i, 5.0), B) for i in range(3)]
    plan = plan_keyframes([*left, *right], [0, 1, 2, 0, 1, 2])
    assert plan.visit_order == (2, 5, 1, 4, 0, 3)
    assert len(plan.keyframes) == 1 and plan.keyframes[0].frame in (2, 5)
    assert plan.remaining.sum() <= 40


def test_too_little_makes_no_keyframe() -> None:
    speck = (-0.05, 0.05, -0.05, 0.05)
    holes = [hole_of(before_wall(0.0, 5.0), speck), hole_of(before_wall(0.1, 5.0))]
    plan = plan_keyframes(holes, [0, 1])
    assert plan.keyframes == () and plan.remaining.tolist() == [int(holes[0].mask.sum()), 0]


def test_a_frame_that_others_together_make_needless_is_no_keyframe() -> None:
    """Frame 0 shows most; what the later ones add to it is needed, and with it they show all that frame 0 does."""
    camera = before_wall(0.0, 5.0)
    below = [(left, right, 0.8, 1.8) for left, right, _, _ in (A, B, C)]
    holes = [hole_of(camera, A, B, C), *(hole_of(camera, p, q) for p, q in zip((A, B, C), below, strict=True))]
    plan = plan_keyframes(holes, range(4))
    assert chosen(plan) == [3, 2, 1] and plan.remaining.sum() == 0
    assert [k.area for k in plan.keyframes] == pytest.approx([2.0] * 3, rel=0.1)


def test_a_plan_that_is_interrupted_goes_on_where_it_was(tmp_path: Path) -> None:
    cameras = [before_wall(0.1 * i, 2.6 + 1.9 * i) for i in range(4)]
    holes = [hole_of(c, *parts) for c, parts in zip(cameras, [(B,), (A,), (B, C), (A, B)], strict=True)]
    asked, most = 0, 10**6

    def ask(i: int) -> Hole:
        nonlocal asked
        if asked >= most:
            raise InterruptedError
        asked += 1
        return holes[i]

    frames = Frames(len(holes), ask)
    whole = plan_keyframes(frames, range(4))
    needed, asked = asked, 0
    assert len(whole.keyframes) > 1 and any(k.deferred.any() for k in whole.keyframes)
    for most in range(needed):
        kept = Kept(tmp_path / str(most), every_s=0.0)
        asked = 0
        with pytest.raises(InterruptedError):
            plan_keyframes(frames, range(4), kept=kept)
        asked, most = 0, 10**6
        plan = plan_keyframes(frames, range(4), kept=kept)
        assert plan.visit_order == whole.visit_order and plan.remaining.tolist() == whole.remaining.tolist()
        for one, other in zip(plan.keyframes, whole.keyframes, strict=True):
            assert (one.frame, one.area, one.pixels) == (other.frame, other.area, other.pixels)
            assert np.array_equal(one.deferred, other.deferred)
    # Of the last attempt, which lacked one look, nearly nothing was done again.
    assert asked < 0.7 * needed


def test_what_is_carried_has_no_gaps_and_no_more_than_there_is() -> None:
    far, near = hole_of(before_wall(0.0, 8.0), B), hole_of(before_wall(0.3, 2.5), A, B)
    shown = np.zeros_like(near.mask)
    shown[near.mask] = carried(far.points(), far.depth / far.camera.fx, near)
    truth = shows(near.camera, B)
    # Its border is as coarse as the far view's pixels.
    assert shown[truth].mean() > 0.97 and shown[~truth].sum() < 0.05 * truth.sum()


def test_sharper_means_finer_pixels_on_the_same_place() -> None:
    far, near = hole_of(before_wall(0.0, 8.0), A, B), hole_of(before_wall(0.3, 2.5), B)
    mask = np.zeros_like(far.mask)
    mask[far.mask] = sharper_elsewhere(far, [near])
    assert np.array_equal(mask, shows(far.camera, B))
    assert not sharper_elsewhere(near, [far]).any()
    large = hole_of(replace(before_wall(0.0, 8.0), width=960, height=720, fx=600, fy=600, cx=480, cy=360), A, B)
    assert len(large.depth) > 10_000
    finest = hole_of(replace(near.camera, fx=800.0, fy=800.0, width=960, height=720, cx=480, cy=360), B)
    asked = np.zeros_like(large.mask)
    asked[large.mask] = sharper_elsewhere(large, [finest])
    wrong = asked ^ (shows(large.camera, B) & large.mask)
    assert wrong.sum() < 0.03 * asked.sum()
