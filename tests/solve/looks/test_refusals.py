"""What cannot be solved is told before the work: one line, with what helps."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.solve.films import SIZE, frames
from unveil_core.base.errors import DriveError
from unveil_core.solve.footage.frames import FootageFrame
from unveil_core.solve.looks.choice import chosen_frames
from unveil_core.solve.looks.hidden import bonnet_of
from unveil_core.solve.looks.motion import motion_of
from unveil_core.solve.looks.refusals import check_can_work
from unveil_core.solve.looks.thumbs import Thumbs


def looked_at(pictures: list[np.ndarray]) -> tuple[Thumbs, list[str]]:
    """Grey or RGB pictures, checked."""
    greys = [cv2.cvtColor(p, cv2.COLOR_RGB2GRAY) if p.ndim == 3 else p for p in pictures]
    thumbs = Thumbs(tuple(FootageFrame("camera", f"{k:04d}", k, f"{k:04d}.png") for k in range(len(greys))), greys)
    motion = motion_of(thumbs)
    return thumbs, check_can_work("clip.mp4", thumbs, motion, chosen_frames(motion, thumbs.sharpness))


def film() -> list[np.ndarray]:
    return list(frames())


def noisy(picture: np.ndarray, k: int) -> np.ndarray:
    return np.clip(picture + np.random.default_rng(k).normal(0, 2, picture.shape), 0, 255).astype(np.uint8)


def test_a_street_is_fine() -> None:
    assert looked_at(film())[1] == []


def test_five_frames() -> None:
    with pytest.raises(DriveError, match=r"clip\.mp4: Too few frames: 5, and a solve needs 6 .*longer part"):
        looked_at(film()[:5])


def test_a_standing_camera() -> None:
    with pytest.raises(DriveError, match="The camera stands still.*film while driving"):
        looked_at([noisy(film()[0], k) for k in range(12)])


def test_a_cut_names_the_longest_shot() -> None:
    first = film()
    other = [np.ascontiguousarray(np.rot90(p, 2)[::1, ::-1]) for p in first[:6]]
    with pytest.raises(DriveError, match=r"A cut before frame 10: .*--frames 0:10 is the longest"):
        looked_at([*first[:10], *other])


def test_night() -> None:
    dark = [noisy((p * 0.012).astype(np.uint8), k) for k, p in enumerate(film())]
    with pytest.raises(DriveError, match="The footage is too dark .mean grey . of 255.: .*film by day"):
        looked_at(dark)


@pytest.mark.parametrize(
    ("radius", "told"),
    [
        (40, "films a single wall"),
        (24, "Too little can be tracked: .* corners .*more frames a second"),
    ],
)
def test_a_bare_wall(radius: int, told: str) -> None:
    walls = [np.full((200, 320), 120, np.uint8) for _ in range(10)]
    for k, wall in enumerate(walls):
        cv2.circle(wall, (60 + 14 * k, 100), radius, 170, -1)
    with pytest.raises(DriveError, match=told):
        looked_at([cv2.GaussianBlur(w, (0, 0), 3) for w in walls])


def test_dim_footage_is_solved_and_said_to_be_dim() -> None:
    _, told = looked_at([(p * 0.2).astype(np.uint8) for p in film()])
    assert len(told) == 1 and "dark" in told[0]


def test_a_camera_that_only_turns() -> None:
    """A panorama: each frame is a homography of one picture."""
    picture, found = film()[3], []
    lens = np.array([[350.0, 0, 240], [0, 350, 135], [0, 0, 1]])
    for k in range(14):
        turn = cv2.Rodrigues(np.array([0.0, np.radians(1.3 * k - 8), 0.0]))[0]
        found.append(
            cv2.warpPerspective(picture, lens @ turn @ np.linalg.inv(lens), SIZE, borderMode=cv2.BORDER_REFLECT)
        )
    with pytest.raises(DriveError, match="moves as one plane.*only turns.*move the camera along"):
        looked_at([f[30:240, 100:380] for f in found])


def test_standing_and_blurred_frames_are_left_out() -> None:
    pictures = film()
    pictures = [*pictures[:6], *(noisy(pictures[6], k) for k in range(8)), *pictures[6:]]
    pictures[3] = cv2.GaussianBlur(pictures[3], (0, 0), 4)
    thumbs, _ = looked_at(pictures)
    choice = chosen_frames(motion_of(thumbs), thumbs.sharpness)
    assert 3 not in choice.frames
    assert choice.standing >= 6 and len(set(range(7, 13)) & set(choice.frames)) <= 1
    assert choice.frames[0] == 0 and choice.frames[-1] == len(pictures) - 1


def test_the_bonnet_is_what_never_moves() -> None:
    pictures = film()
    for k, p in enumerate(pictures):
        pictures[k] = p = p.copy()
        p[230:, 40:440] = np.linspace(40, 90, 400)[None, :, None]
    greys = [cv2.cvtColor(p, cv2.COLOR_RGB2GRAY) for p in pictures]
    thumbs = Thumbs(tuple(FootageFrame("camera", f"{k}", k, f"{k}.png") for k in range(len(greys))), greys)
    found = bonnet_of(motion_of(thumbs))
    assert found is not None
    wanted = np.zeros(found.shape, bool)
    wanted[round(230 / 1.5) :, round(40 / 1.5) : round(440 / 1.5)] = True
    assert (found & wanted).sum() / (found | wanted).sum() > 0.7
    assert bonnet_of(motion_of(Thumbs(thumbs.frames, [cv2.cvtColor(p, cv2.COLOR_RGB2GRAY) for p in film()]))) is None
