"""The page in headless Chromium: it fits its window, its sliders and its scene can be used, and nothing leaves it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.report.browser import CHROMIUM, Tab, opened
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.axes import UP
from unveil_core.raster.picture import picture_of
from unveil_core.report.scene.path import looking
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.sky import load_sky

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
CANVAS = "#scene-view canvas"
BORDER = 12


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    with opened(tmp_path_factory.mktemp("browser")) as tab:
        yield tab


@pytest.fixture(scope="module")
def small(scene_workspace: Path, tab: Tab) -> Tab:
    """The page in a small window."""
    tab.resize(500, 600)
    tab.open(scene_workspace / "report/index.html")
    return tab


def drawn(tab: Tab) -> np.ndarray:
    """The scene's picture, after all that was asked for is drawn, without its border: round corners, and the line around what has
    the keyboard."""
    tab.place(CANVAS)
    tab.settle()
    # Where graphics are slow it is coarse at first.
    tab.wait(f"(c => !!c.dataset.view && c.width === c.clientWidth)(document.querySelector('{CANVAS}'))")
    return tab.picture(CANVAS).astype(float)[BORDER:-BORDER, BORDER:-BORDER]


def apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).mean())


@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1024, "dark"), (1920, "light")])
def test_the_page_can_be_used(scene_workspace: Path, tab: Tab, width: int, scheme: str) -> None:
    tab.errors.clear()
    tab.requests.clear()
    tab.resize(width, 600, scheme)
    tab.open(scene_workspace / "report/index.html")
    assert tab.run("document.documentElement.scrollWidth") <= width
    light = tab.run("getComputedStyle(document.body).backgroundColor")
    assert (min(map(int, re.findall(r"\d+", light))) > 200) == (scheme == "light")

    left, top, wide, high = tab.place("#viewer .slider")
    before = tab.picture("#viewer .slider").astype(float)
    tab.drag((left + wide / 2, top + high / 2), (left + 0.95 * wide, top + high / 2))
    split = tab.run("getComputedStyle(document.querySelector('#viewer .slider')).getPropertyValue('--split')")
    assert float(split.rstrip("%")) > 90
    after = tab.picture("#viewer .slider").astype(float)
    assert apart(before[:, : int(0.4 * wide)], after[:, : int(0.4 * wide)]) < 1 < apart(before, after)

    shown = drawn(tab)
    assert shown.std() > 20
    left, top, wide, high = tab.place(CANVAS)
    tab.drag((left + 0.5 * wide, top + 0.5 * high), (left + 0.7 * wide, top + 0.55 * high))
    turned = drawn(tab)
    assert turned.std() > 20 and apart(shown, turned) > 5
    tab.press("ArrowLeft")
    assert apart(turned, drawn(tab)) > 1
    tab.press("Home")
    assert apart(shown, drawn(tab)) < 0.5

    assert tab.errors == []
    assert all(address.startswith(("file://", "data:")) for address in tab.requests)


def test_the_scene_is_drawn_as_the_rasterizer_draws_it(scene_workspace: Path, small: Tab) -> None:
    tab = small
    drawn(tab)
    for _ in range(3):
        tab.run(f"document.querySelector('{CANVAS}').focus()")
        tab.press("ArrowUp")
    shown = drawn(tab)
    view = json.loads(tab.run(f"document.querySelector('{CANVAS}').dataset.view"))
    eye, forward = np.array(view["eye"]), np.array(view["forward"])
    assert shown.shape[:2] == (view["height"] - 2 * BORDER, view["width"] - 2 * BORDER)
    camera = looking(eye, eye + forward, UP, (view["width"], view["height"]), view["focal"])
    surfels, sky = read_surfels(scene_workspace / "surfels/empty.ply"), load_sky(scene_workspace / "surfels/sky.npz")
    true = picture_of(surfels, sky, camera, near=NEAR_M, far=FAR_M)
    error = np.square(shown - true[BORDER:-BORDER, BORDER:-BORDER]).mean()
    assert 10 * np.log10(255**2 / error) > 38


def test_the_drive_the_map_and_the_flight(small: Tab) -> None:
    tab = small
    tab.run("document.querySelector('#scene-view .street').click()")
    start = drawn(tab)
    tab.run(
        "(s => { s.value = s.max; s.dispatchEvent(new Event('input')); })(document.querySelector('#scene-view .scrub'))"
    )
    assert apart(start, drawn(tab)) > 1.5
    tab.run("document.querySelector('#scene-view .origins').click()")
    assert apart(start, drawn(tab)) > 15
    assert tab.run("document.querySelectorAll('#map .removed a').length") == 3
    with_boxes = tab.picture("#map svg").astype(float)
    tab.run("document.querySelector('[data-layer=removed]').click()")
    assert apart(with_boxes, tab.picture("#map svg").astype(float)) > 0.1
    pytest.importorskip("av")
    assert tab.wait("document.querySelector('video').duration > 3")


def test_without_webgl_a_line_says_so(scene_workspace: Path, tab: Tab) -> None:
    script = "HTMLCanvasElement.prototype.getContext = () => null"
    added = tab.ask("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
    try:
        tab.open(scene_workspace / "report/index.html")
        tab.place("#scene-view")
        assert "has no WebGL 2" in tab.wait("document.querySelector('#scene-view .note').textContent")
        assert tab.run(f"document.querySelector('{CANVAS}').hidden")
    finally:
        tab.ask("Page.removeScriptToEvaluateOnNewDocument", identifier=added)
