"""One delivered frame: the footage's own pixels outside of masks, whatever its encoding, and light without seams."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.ground.test_street import look
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image_as_it_is
from unveil_core.base.plates.colours import PlateColours
from unveil_core.delivery.detail import grain_of
from unveil_core.delivery.full_size import CleanFrame, FullSize, as_color, full_size_frame, in_exposure, reduced
from unveil_core.delivery.lens import work_positions
from unveil_core.delivery.views import EmptyView, EmptyViews
from unveil_core.drives.drive import Distortion, Footage
from unveil_core.drives.exposure import IDENTITY, Exposure
from unveil_core.drives.importing.frames import at_work_size, working_camera
from unveil_core.geometry.camera import Camera

CAMERA = Camera(180, 120, 150.0, 150.0, 90.0, 60.0, look(np.array([0.0, 0.0, 1.6]), 0.0).world_to_camera)
LENS = Distortion("OPENCV", (-0.1, 0.02, 0.001, -0.001, 0.0, 0.0, 0.0, 0.0))


def texture(channels: int = 3) -> np.ndarray:
    """(120, 180, C) in [0, 1]: soft patches with grain, nowhere black or white."""
    generator = np.random.default_rng(0)
    noise = generator.normal(size=(120, 180, channels)).astype(np.float32)
    soft = cv2.GaussianBlur(noise, (0, 0), 8).reshape(noise.shape)
    return np.clip(0.5 + 2.0 * soft + 0.03 * noise, 0.15, 0.9)


def kinds() -> dict[str, tuple[str, np.ndarray]]:
    """By name the file's ending, and what it holds."""
    eight, sixteen = (texture() * 255).astype(np.uint8), (texture() * 65535).astype(np.uint16)
    alpha = np.random.default_rng(1).integers(0, 256, (120, 180, 1))
    return {
        "png": (".png", eight),
        "png of 16 bits": (".png", sixteen),
        "jpeg": (".jpg", eight),
        "grey": (".png", eight[..., 0].copy()),
        "grey of 16 bits": (".png", sixteen[..., 0].copy()),
        "grey jpeg": (".jpg", eight[..., 0].copy()),
        "rgba": (".png", np.concatenate([eight, alpha.astype(np.uint8)], axis=2)),
        "rgba of 16 bits": (".png", np.concatenate([sixteen, (alpha * 257).astype(np.uint16)], axis=2)),
    }


def delivered(
    picture: np.ndarray,
    removed: np.ndarray,
    relit: np.ndarray,
    clean: np.ndarray,
    *,
    side: int = 90,
    lens: Distortion | None = None,
    depth_m: float = 0.0,
    plate: PlateColours | None = None,
) -> np.ndarray:
    """The frame of a drive of one frame, without ground, and without surface or before a wall.

    Args:
        picture: as a file has it; removed, relit: (h, w) of working size.
        clean: (h, w, 3) uint8 of working size.
        depth_m: of the wall; plate: what the picture means, where it is of a plate.
    """
    footage = Footage(Path("f.png"), CAMERA, lens, plate)
    camera = working_camera(CAMERA, side)
    photograph = at_work_size((as_color(picture) * 255).round().astype(np.uint8), footage, camera)
    view = EmptyView(camera, np.full(removed.shape, depth_m, np.float32), removed | relit)
    drive = FullSize(
        views=EmptyViews([camera], [view]),
        footage=lambda _: picture,
        coarse=lambda _: reduced(picture, footage, camera),
        lenses=[footage],
        exposures=[Exposure()],
        grain=lambda _, sigma: grain_of(picture, sigma),
        ground=None,
        shifts=None,
    )
    return full_size_frame(CleanFrame(footage, photograph, clean, removed, relit), 0, drive, picture)


def masks(side: int = 90) -> tuple[np.ndarray, np.ndarray]:
    removed, relit = np.zeros((2, round(side * 2 / 3), side), bool)
    removed[20:40, 30:50] = True
    relit[36:50, 30:70] = True
    return removed, relit & ~removed


def nearest(mask: np.ndarray, times: int) -> np.ndarray:
    return mask.repeat(times, axis=0).repeat(times, axis=1)


@pytest.mark.parametrize("lens", [None, LENS], ids=["pinhole", "lens"])
@pytest.mark.parametrize("kind", kinds())
def test_outside_of_masks_the_pixels_are_those_of_the_file(kind: str, lens: Distortion | None, tmp_path: Path) -> None:
    suffix, content = kinds()[kind]
    path = tmp_path / f"footage{suffix}"
    order = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
    cv2.imwrite(str(path), cv2.cvtColor(content, order[content.shape[2]]) if content.ndim == 3 else content)
    picture = read_image_as_it_is(path)
    assert picture.shape == content.shape and picture.dtype == content.dtype
    removed, relit = masks()
    camera = working_camera(CAMERA, 90)
    clean = at_work_size((as_color(picture) * 255).astype(np.uint8), Footage(path, CAMERA, lens), camera)
    clean[removed | relit] = 255 - clean[removed | relit]
    frame = delivered(picture, removed, relit, clean, lens=lens)
    write_image_atomic(tmp_path / "frame.png", frame)
    # Read back by another decoder's rules than ours: as the file has it.
    back = cv2.imread(str(tmp_path / "frame.png"), cv2.IMREAD_UNCHANGED)
    own = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert back.shape == own.shape and back.dtype == own.dtype
    # The lens moves no pixel of this picture by more than five.
    touched = cv2.dilate(nearest(removed | relit, 2).astype(np.uint8), np.ones((13, 13))) > 0
    assert np.array_equal(back[~touched], own[~touched]) and not touched.all()
    inside = cv2.erode(nearest(removed, 2).astype(np.uint8), np.ones((15, 15))) > 0
    color = back[..., :3] if back.ndim == 3 else back
    changed = (color != (own[..., :3] if own.ndim == 3 else own)).reshape(*touched.shape, -1).any(axis=-1)
    assert changed[inside].mean() > 0.9
    if back.ndim == 3 and back.shape[2] == 4:
        # What is put in is opaque; the transparency of all else is the file's.
        other = back[..., 3] != own[..., 3]
        assert (back[..., 3][other] == np.iinfo(back.dtype).max).all() and not other[~touched].any()
        assert (back[..., 3][inside] == np.iinfo(back.dtype).max).all() and other[inside].mean() > 0.9


def test_nothing_removed_is_the_file() -> None:
    picture = (texture() * 255).astype(np.uint8)
    nothing = np.zeros((60, 90), bool)
    assert np.array_equal(delivered(picture, nothing, nothing, np.zeros((60, 90, 3), np.uint8)), picture)


@pytest.mark.parametrize("side", [180, 90, 45])
def test_a_removed_part_is_the_clean_frame_with_a_short_seam(side: int) -> None:
    """A bright box on a grey street: what is delivered is the grey, and no more than two working pixels of the box remain."""
    scale = 180 // side
    removed = np.zeros((120 // scale, side), bool)
    removed[16 // scale * 2 : 80 // scale, 60 // scale : 120 // scale] = True
    picture = np.full((120, 180, 3), 120, np.uint8)
    shown = cv2.erode(nearest(removed, scale).astype(np.uint8), np.ones((2 * scale + 1,) * 2)) > 0
    picture[shown] = 240
    clean = np.full((*removed.shape, 3), 120, np.uint8)
    frame = delivered(picture, removed, np.zeros_like(removed), clean, side=side)
    deep = cv2.erode(nearest(removed, scale).astype(np.uint8), np.ones((4 * scale + 3,) * 2)) > 0
    assert deep.any() and np.abs(frame[deep].astype(int) - 120).max() <= 2
    around = nearest(cv2.dilate(removed.astype(np.uint8), np.ones((3, 3))) > 0, scale)
    assert (frame[~around] == 120).all()


@pytest.mark.parametrize("lens", [None, LENS], ids=["pinhole", "lens"])
def test_light_beside_removed_pixels_has_no_dark_line(lens: Distortion | None) -> None:
    """A car (dark) with its shadow (half the light) on grey: where both are gone, all is grey, also along their border."""
    street = 160.0
    camera, footage = working_camera(CAMERA, 60), Footage(Path("f.png"), CAMERA, lens)
    removed, shadow = np.zeros((2, 40, 60), bool)
    removed[12:24, 20:34] = True
    shadow[20:32, 20:48] = True
    flat = np.full((40, 60), street)
    flat[shadow] *= 0.5
    # Masks hold the antialiased border of an object, too.
    flat[cv2.erode(removed.astype(np.uint8), np.ones((3, 3))) > 0] = 30
    shadow &= ~removed
    # The picture of the footage's size, in its lens: each pixel shows what its place of working size does.
    at = work_positions(footage, camera)
    column, row = (np.clip(at[..., k].astype(int), 0, n - 1) for k, n in ((0, 60), (1, 40)))
    gray = flat[row, column].astype(np.uint8)
    picture = np.repeat(gray[..., None], 3, axis=2)
    clean = np.full((40, 60, 3), round(street), np.uint8)
    frame = delivered(picture, removed, shadow, clean, side=60, lens=lens).astype(float)
    both = (removed | shadow)[row, column]
    border = cv2.morphologyEx(removed.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3)))[row, column] > 0
    inner = cv2.erode(both.astype(np.uint8), np.ones((9, 9))) > 0
    line = border & inner & shadow[row, column]
    assert line.sum() > 20
    # Light that was estimated beside the car's pixels is that of the shadow, not of the car.
    assert np.abs(frame[line] - street).max() < 8
    assert np.abs(frame[inner] - street).mean() < 4
    assert frame[inner].min() > 0.75 * street


def test_relit_footage_keeps_its_grain() -> None:
    """Light is a ratio: five times the light doubles the contrast, which a clean frame of working size has lost."""
    generator = np.random.default_rng(0)
    grain = generator.normal(0, 5, (120, 180))
    level = np.full((120, 180), 140.0)
    relit = np.zeros((40, 60), bool)
    relit[8:30, 10:50] = True
    shaded = nearest(relit, 3)
    picture = np.where(shaded, (level + grain) / 2, level + grain)
    picture = np.repeat(picture.round().astype(np.uint8)[..., None], 3, axis=2)
    clean = np.full((40, 60, 3), 140, np.uint8)
    frame = delivered(picture, np.zeros_like(relit), relit, clean, side=60)[..., 0].astype(float)
    inner = cv2.erode(shaded.astype(np.uint8), np.ones((9, 9))) > 0
    assert abs(frame[inner].mean() - 140) < 3
    high = frame - cv2.GaussianBlur(frame, (0, 0), 2)
    wanted = grain - cv2.GaussianBlur(grain, (0, 0), 2)
    assert np.corrcoef(high[inner], wanted[inner])[0, 1] > 0.9
    assert 0.7 < high[inner].std() / wanted[inner].std() < 1.3


def test_a_deep_blue_shadow_comes_out_as_grey_as_the_street() -> None:
    """Under a car hardly any light is left, and that is the sky's: red gains ten times, blue four."""
    relit = np.zeros((40, 60), bool)
    relit[8:30, 10:50] = True
    shaded = nearest(relit, 3)
    dark = np.array([0.03, 0.035, 0.09], np.float32)
    picture = np.full((120, 180, 3), 0.4, np.float32)
    picture[shaded] = dark
    generator = np.random.default_rng(0)
    picture *= 1 + 0.05 * generator.normal(size=(120, 180, 1)).astype(np.float32)
    clean = np.full((40, 60, 3), round(0.4 * 255), np.uint8)
    frame = delivered((picture * 255).round().astype(np.uint8), np.zeros_like(relit), relit, clean, side=60)
    inside = cv2.erode(shaded.astype(np.uint8), np.ones((7, 7))) > 0
    mean = frame[inside].astype(float).mean(axis=0) / 255
    assert np.abs(mean - 0.4).max() < 0.02
    assert frame[inside].std() > 1.0  # it is the footage, not the enlarged clean frame


def test_what_a_darker_camera_shows_is_brought_to_the_colours_of_the_frame() -> None:
    street = np.random.default_rng(0).random((20, 3)).astype(np.float32)
    dark, bright = Exposure(np.full(3, 0.6), np.full(3, 0.02)), Exposure(np.array([1.2, 1.0, 0.9]), np.zeros(3))
    as_dark, as_bright = ((street * e.gain + e.bias).astype(np.float32) for e in (dark, bright))
    assert np.abs(in_exposure(as_dark, dark, bright) - as_bright).max() < 1e-6
    assert in_exposure(street, IDENTITY, IDENTITY) is street
