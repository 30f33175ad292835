"""The page on a finished workspace and on poorer ones: complete, self-contained, safe, small."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.evaluate.street_workspace import CARS, OFFSET, build_workspace
from tests.mesh.street import cast, street_camera
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate import run_evaluation, write_metrics
from unveil_core.evaluate.detail.scores import DETAIL_FIGURES, SPECTRUM_FIGURES
from unveil_core.mesh import DepthView, Mesh, fuse, render_mesh_picture, write_ply
from unveil_core.report import write_report
from unveil_core.report.collect import bird_camera
from unveil_core.report.pictures import REGION_COLORS, fitted, page_size, pick
from unveil_core.report.wording import detail
from unveil_core.workspace.assumptions import Assumption, assumed

VOID = {"meta", "link", "img", "input", "br", "line", "polyline", "image", "circle", "polygon"}


class Page(HTMLParser):
    """Collects elements and checks that they nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attributes)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts.append((self.found[-1][1], data))
        elif not self.open or self.open[-1] != "style":
            self.text += data

    def headings(self) -> list[str]:
        return re.findall(r"Against the true|The street as a mesh|Objects|Time and memory|Settings", self.text)

    def frames(self) -> list[dict[str, str]]:
        (data,) = [text for attributes, text in self.scripts if attributes.get("id") == "frames"]
        frames: list[dict[str, str]] = json.loads(data)
        return frames


def decoded(uri: str) -> np.ndarray:
    raw = base64.b64decode(uri.split(",", 1)[1], validate=True)
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    workspace = build_workspace(tmp_path_factory.mktemp("street"), count=4, width=120, height=80)
    local = read_imported(workspace / "drive")
    for state, cars in (("full", CARS), ("empty", ())):
        views = []
        for i in range(4):
            camera = street_camera(1.2 * i, 120, 80)
            seen = cast(camera, cars)
            views.append(DepthView(camera, seen["depth"], seen["rgb"]))
        mesh = fuse(views, voxel_size=0.2, max_depth=15.0)
        shifted = (mesh.vertices.astype(np.float64) + OFFSET - local.to_world.translation).astype(np.float32)
        write_ply(Mesh(shifted, mesh.faces, mesh.colors), workspace / f"meshes/{state}.ply", local.to_world)
    write_metrics(run_evaluation(workspace), workspace / "metrics.json")
    return workspace


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished, tmp_path / "workspace")
    return tmp_path / "workspace"


def page_of(workspace: Path, out: Path | None = None) -> tuple[str, Page]:
    out = out or workspace / "report"
    write_report(workspace, out)
    movie = ["before_after.mp4"] if (workspace / "frames").is_dir() else []
    assert sorted(p.name for p in out.iterdir()) == [*movie, "index.html"]
    text = (out / "index.html").read_text()
    return text, Page(text)


def test_everything_is_there(finished: Path, tmp_path: Path) -> None:
    text, page = page_of(finished, tmp_path / "report")
    assert page.headings() == ["Against the true", "The street as a mesh", "Objects", "Time and memory", "Settings"]
    assert len(page.frames()) == 4
    assert set(page.frames()[0]) == {"name", "label", "before", "after", "rendered", "inpainted", "lines", "regions"}
    metrics = json.loads((finished / "metrics.json").read_text())
    removed = metrics["truth"]["regions"]["removed"]["methods"]
    for method in ("ours", "telea", "shift_map"):
        assert f"{removed[method]['psnr']:.1f} dB" in page.text
    assert "Spectrum, 2 to 4 px" in page.text
    for figure in DETAIL_FIGURES:
        assert f"<td>{detail(figure, removed['ours'][figure])}</td>" in text
    assert "found in green, missed in red" in page.text
    cards = dict(re.findall(r'<div class="card number"><b>(.*?)</b><span>(.*?)</span>', text))
    ours = {name: detail(name, removed["ours"][name]) for name in ("gradient", "line_recall", "false_lines")}
    assert "gradient energy" in cards[ours["gradient"]]
    assert "lines on the ground" in cards[f"{ours['line_recall']} / {ours['false_lines']}"]
    assert "removed: 3 cars" in page.text
    assert "vehicle" in page.text
    assert "polyline" in text


def test_it_needs_nothing_but_itself(finished: Path, tmp_path: Path) -> None:
    text, page = page_of(finished, tmp_path / "report")
    for _, attributes in page.found:
        for name in ("src", "href"):
            assert (attributes.get(name) or "data:").startswith("data:")
    assert not re.search(r"https?://|@import|url\(|fetch\(|XMLHttpRequest", text)


def test_the_pictures_are_those_of_the_workspace(finished: Path, tmp_path: Path) -> None:
    _, page = page_of(finished, tmp_path / "report")
    paths = {f.name: f.image_path for f in read_imported(finished / "drive").frames}
    for frame in page.frames():
        before = decoded(frame["before"])[..., ::-1].astype(float)
        after = decoded(frame["after"])[..., ::-1].astype(float)
        photograph = read_image(paths[frame["name"]])
        empty = read_image(finished / f"frames/front/{frame['name']}.png")
        # JPEG errs by some levels on so small a picture with such hard edges; the wrong picture errs where the car is.
        car = np.abs(photograph.astype(int) - empty).max(axis=2) > 60
        assert np.abs(before - photograph)[car].mean() < 20 < np.abs(before - empty)[car].mean()
        assert np.abs(after - empty)[car].mean() < 20 < np.abs(after - photograph)[car].mean()
        overlay = decoded(frame["regions"])
        regions = cv2.imread(str(finished / f"regions/front/{frame['name']}.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(overlay[..., 3] > 0, regions > 0)
        for region, color in REGION_COLORS.items():
            assert (overlay[regions == region][:, :3] == color[::-1]).all()


def test_the_slider_is_an_input(finished: Path, tmp_path: Path) -> None:
    """Keyboards and screen readers know what a range input is."""
    _, page = page_of(finished, tmp_path / "report")
    ranges = [a for tag, a in page.found if tag == "input"]
    assert len(ranges) == 4
    assert all(a["type"] == "range" and a["aria-label"] for a in ranges)


def test_a_bare_workspace_still_has_a_page(workspace: Path) -> None:
    for name in ("frames", "renders", "inpainted", "regions", "masks", "meshes", "instances"):
        shutil.rmtree(workspace / name)
    for name in ("metrics.json", "instances.json", "workspace.json"):
        (workspace / name).unlink()
    _, page = page_of(workspace)
    assert page.headings() == []
    assert set(page.frames()[0]) == {"name", "label", "before"}
    assert "None" not in page.text
    assert "nan" not in page.text.lower().split()


@pytest.mark.parametrize(
    ("gone", "heading"), [("meshes", "The street as a mesh"), ("instances.json", "Objects"), ("frames", None)]
)
def test_absent_pieces_are_left_out(workspace: Path, gone: str, heading: str | None) -> None:
    path = workspace / gone
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    _, page = page_of(workspace)
    assert heading not in page.headings()
    assert len(page.headings()) == (5 if heading is None else 4)


def test_without_truth(workspace: Path) -> None:
    metrics = json.loads((workspace / "metrics.json").read_text())
    del metrics["truth"]
    for entry in metrics["per_frame"]:
        for figure in ("psnr", "ssim", *DETAIL_FIGURES):
            del entry[figure]
    write_report(workspace, workspace / "report", metrics)
    page = Page((workspace / "report/index.html").read_text())
    assert "Against the true" not in page.headings()
    assert "Not one" in page.text


def test_exact_and_undefined_numbers(workspace: Path) -> None:
    metrics = json.loads((workspace / "metrics.json").read_text())
    for region in metrics["truth"]["regions"].values():
        region["methods"]["ours"]["psnr"] = None
    metrics["per_frame"][1]["psnr"]["ours"] = None
    metrics["truth"]["regions"]["removed"]["methods"]["ours"]["line_recall"] = None
    write_report(workspace, workspace / "report", metrics)
    page = Page((workspace / "report/index.html").read_text()).text
    false = metrics["truth"]["regions"]["removed"]["methods"]["ours"]["false_lines"]
    assert "exact" in page and f"– / {detail('false_lines', false)}lines on the ground" in page
    metrics["truth"]["regions"]["removed"]["methods"]["ours"]["false_lines"] = None
    write_report(workspace, workspace / "report", metrics)
    assert "lines on the ground there" not in Page((workspace / "report/index.html").read_text()).text


def metrics_without(workspace: Path, figures: Sequence[str]) -> dict[str, Any]:
    """The metrics of a workspace, as an earlier version wrote them."""
    metrics = json.loads((workspace / "metrics.json").read_text())
    for region in metrics["truth"]["regions"].values():
        for values in region["methods"].values():
            for name in figures:
                values.pop(name, None)
    return metrics


def test_metrics_of_before_the_details(workspace: Path) -> None:
    """A workspace of an earlier version has none of them in its metrics.json."""
    metrics = metrics_without(workspace, DETAIL_FIGURES)
    del metrics["truth"]["residue_by_object"]
    write_report(workspace, workspace / "report", metrics)
    page = Page((workspace / "report/index.html").read_text())
    assert "Against the true" in page.headings() and "False lines" not in page.text
    assert not any(words in page.text for words in ("gradient energy", "lines on the ground there"))


def test_metrics_of_before_the_spectrum(workspace: Path) -> None:
    write_report(workspace, workspace / "report", metrics_without(workspace, SPECTRUM_FIGURES))
    page = Page((workspace / "report/index.html").read_text())
    assert "False lines" in page.text and "Spectrum" not in page.text


def test_the_objects_of_which_most_is_left_are_named(workspace: Path) -> None:
    metrics = json.loads((workspace / "metrics.json").read_text())
    metrics["truth"]["residue_by_object"] = [
        {"id": i, "class": "car", "left": left, "pixels": 1000, "residue": left / 1000}
        for i, left in ((4, 300), (2, 20), (7, 10), (5, 5), (1, 0))
    ]
    write_report(workspace, workspace / "report", metrics)
    text = Page((workspace / "report/index.html").read_text()).text
    assert "Most is left of: car 4 (30 %), car 2 (2.0 %), car 7 (1.0 %)." in text


def test_words_from_files_are_only_words(workspace: Path) -> None:
    evil = '</script><script>alert("x")</script><img src=x onerror=alert(1)>'
    state = json.loads((workspace / "workspace.json").read_text())
    state["drive"] = f"/drives/{evil.replace('/', '')}"
    state["settings"]["remove"] = [evil]
    write_json_atomic(workspace / "workspace.json", state)
    write_json_atomic(
        workspace / "instances.json",
        [
            {"id": evil, "class": evil, "thumbnail": "../../../etc/hostname", "first_frame": evil, "removed": True},
            {"id": 1, "class": "car", "picture": 'x" onerror="alert(1)'},
            7,
        ],
    )
    cameras = (workspace / "drive/cameras.json").read_text()
    document = json.loads(cameras)
    document["frames"][0]["name"] = "&lt;b onerror='x'"
    (workspace / "drive/cameras.json").write_text(json.dumps(document))
    _, page = page_of(workspace)
    assert sum(tag == "script" for tag, _ in page.found) == 2
    assert not any("onerror" in attributes for _, attributes in page.found)
    assert page.frames()[0]["name"] == "&lt;b onerror='x'"
    assert not any(tag == "b" and "class" in attributes for tag, attributes in page.found)


def test_only_its_own_script_may_run(finished: Path, tmp_path: Path) -> None:
    _, page = page_of(finished, tmp_path / "report")
    (policy,) = [a["content"] for tag, a in page.found if tag == "meta" and "content-security-policy" in str(a).lower()]
    (script,) = [text for attributes, text in page.scripts if not attributes]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert policy is not None and f"script-src 'sha256-{digest}'" in policy and "default-src 'none'" in policy
    assert "unsafe-inline" not in policy.split("script-src")[1]


def test_damaged_json_is_one_line(workspace: Path) -> None:
    (workspace / "instances.json").write_text("{")
    with pytest.raises(WorkspaceError, match=r"instances\.json"):
        write_report(workspace, workspace / "report")
    assert not (workspace / "report").exists()


def test_the_mesh_is_seen_in_both_views(finished: Path) -> None:
    drive = read_imported(finished / "drive")
    camera = bird_camera(drive)
    centre = np.array([[8.0, 0.0, 0.0]]) + OFFSET - drive.to_world.translation
    pixel, depth = camera.project(centre)
    assert depth[0] > 0
    assert 0 < pixel[0, 0] < camera.width
    assert 0 < pixel[0, 1] < camera.height
    assert camera.centre[2] > drive.frames[0].camera.centre[2] + 3
    assert render_mesh_picture(Mesh.empty(), camera).shape == (camera.height, camera.width, 3)


@pytest.mark.parametrize(("width", "height"), [(384, 256), (1024, 768), (1920, 1280), (4000, 200)])
@pytest.mark.parametrize("count", [1, 28, 400])
def test_pages_stay_small(width: int, height: int, count: int) -> None:
    chosen = pick(count)
    assert chosen[0] == 0
    assert chosen[-1] == count - 1
    assert len(set(chosen)) == len(chosen) <= 32
    wide, tall = page_size(width, height, len(chosen))
    assert wide <= width
    assert tall <= height
    assert wide * tall * len(chosen) <= 3_500_000 or max(wide, tall) <= 320
    assert wide / tall == pytest.approx(width / height, rel=0.05)
    if (width, height) == (384, 256):
        assert (wide, tall) == (width, height)


def test_provenance_and_certainty_have_views_a_legend_and_a_card(finished: Path, tmp_path: Path) -> None:
    root = tmp_path / "ws"
    shutil.copytree(finished, root)
    for path in (root / "regions/front").glob("*.png"):
        regions = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        write_image_atomic(root / "provenance/front" / path.name, np.where(regions > 0, 3, 0).astype(np.uint8))
        write_image_atomic(root / "certainty/front" / path.name, np.where(regions > 0, 250, 255).astype(np.uint8))
    metrics = run_evaluation(root)
    write_report(root, tmp_path / "report", metrics)
    page = Page((tmp_path / "report/index.html").read_text())
    assert {"provenance", "certainty"} <= {a.get("data-mode") for _, a in page.found}
    assert {"provenance", "certainty"} <= {a.get("data-legend") for _, a in page.found}
    assert "continued from what was seen" in page.text and "counts as certain" in page.text
    for frame in page.frames():
        drawn = decoded(frame["provenance"]).astype(int)
        regions = cv2.imread(str(root / f"regions/front/{frame['name']}.png"), cv2.IMREAD_UNCHANGED)
        inside = cv2.erode((regions > 0).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        blue, _, red = drawn[inside].mean(axis=0)
        assert not inside.any() or blue > red + 40


def test_regions_stay_in_place_when_the_page_shrinks_them() -> None:
    wide = np.zeros((1280, 1920), np.uint8)
    wide[401:704, 601:1404] = 3
    small = fitted(wide, (768, 512), labels=True)
    rows, columns = np.nonzero(small == 3)
    assert abs(columns.mean() + 0.5 - 1002.5 * 0.4) < 0.25 and abs(rows.mean() + 0.5 - 552.5 * 0.4) < 0.25
    assert set(np.unique(small)) == {0, 3}


def test_free_viewpoints_stand_beside_the_recorded_ones(finished: Path, tmp_path: Path) -> None:
    assert "From free viewpoints" not in page_of(finished, tmp_path / "without")[1].text
    metrics = json.loads((finished / "metrics.json").read_text())

    def scores(psnr: float | None, ssim: float) -> dict[str, object]:
        return {"psnr": psnr, "ssim": ssim, "pixels": 9, "views": 2}

    regions = {"free_removed": scores(18.24, 0.611), "free_whole": scores(23.46, 0.702)}
    tracks = {"beside": {"free_removed": scores(17.31, 0.577), "free_whole": scores(None, 1.0)}}
    metrics["free_views"] = {"views": 4, "regions": regions, "tracks": tracks}
    write_report(finished, tmp_path / "with", metrics)
    text = Page((tmp_path / "with/index.html").read_text()).text
    table = text[text.index("From free viewpoints") :]
    assert "from 4 places where the drive never was" in table
    recorded = metrics["truth"]["regions"]["removed"]["methods"]["render"]["psnr"]
    order = [
        "Whole removed region",
        "Whole picture",
        "Recorded places",
        f"{recorded:.1f} dB",
        "All free viewpoints",
        "18.2 dB",
        "/ 0.611",
        "23.5 dB",
        "Beside",
        "17.3 dB",
        "/ 0.577",
        "exact",
    ]
    places = [table.index(word) for word in order]
    assert places == sorted(places)


def test_assumptions_that_do_not_hold_say_what_is_done_instead(workspace: Path) -> None:
    assert "Assumptions" not in page_of(workspace)[1].text
    state = json.loads((workspace / "workspace.json").read_text())
    street = Assumption("the way is one street", False, "goes round in <b>circles</b>", "without charts")
    ground = Assumption("the ground was seen", True, "by its labels", "nothing of it is kept")
    state["stages"].setdefault("ground", {}).update(assumed([street, ground]))
    write_json_atomic(workspace / "workspace.json", state)
    _, page = page_of(workspace)
    section = page.text[page.text.index("Assumptions") :]
    places = [
        section.index(words)
        for words in (street.name, f"no: {street.found}; {street.instead}", ground.name, f"yes: {ground.found}")
    ]
    assert places == sorted(places)
    assert ground.instead not in page.text


def test_a_long_list_of_objects_ends(workspace: Path) -> None:
    (entry, *_) = json.loads((workspace / "instances.json").read_text())
    entries = [{**entry, "id": k, "removed": k % 2 == 1} for k in range(1, 701)]
    write_json_atomic(workspace / "instances.json", entries)
    _, page = page_of(workspace)
    cards = [a for tag, a in page.found if tag == "li" and str(a.get("id")).startswith("object-")]
    assert len(cards) == 500 and "And 200 more" in page.text
    assert [a["class"] for a in cards[:350]] == ["card"] * 350  # the removed ones come first
    assert sum(tag == "img" and a.get("loading") == "lazy" for tag, a in page.found) == 160


@pytest.mark.parametrize("home", ["/home/alice.secret/clients", "C:\\Users\\alice.secret"])
def test_the_page_names_no_folders_of_this_machine(workspace: Path, home: str) -> None:
    separator = home[-len("/clients")] if home.startswith("/") else "\\"
    state = json.loads((workspace / "workspace.json").read_text())
    state["drive"] = f"{home}{separator}street{separator}transforms.json"
    state["settings"] |= {"segmenter": f"{home}{separator}net.onnx", "keyframes": [f"{home}{separator}3"]}
    write_json_atomic(workspace / "workspace.json", state)
    text, page = page_of(workspace)
    assert "alice" not in text and "clients" not in text
    assert "street/transforms.json" in page.text and "net.onnx" in page.text
