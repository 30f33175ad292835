"""Whole runs on a small street: the car goes, the rest stays bit for bit, the same again, and after a kill too."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import unveil_core.pipeline.run as run_module
from tests.drives.tiny_drive import make_tiny_drive
from tests.small_street import make_small_street
from unveil_core.drives.imported import read_imported
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.chart.files import read_chart_sources
from unveil_core.inpaint.chart.street_chart import INVENTED
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.up_to_date import depends_on
from unveil_core.workspace.workspace import Workspace

# Few steps: what they lead to is for the tests of the reconstruction, which choose for themselves how many they take.
STEPS, SPLATS = 100, 8_000
DRAFT = RunSettings(quality="draft", iterations=STEPS, splats=SPLATS, baselines=True)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_small_street(tmp_path_factory.mktemp("street"))


@pytest.fixture(scope="module")
def opened() -> list[tuple[str, str, bool]]:
    """(running stage, path, whether to write) of every file that the run of ``done`` opened through Python."""
    return []


@pytest.fixture(scope="module")
def done(street: Path, opened: list[tuple[str, str, bool]], tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    now = [""]

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and now[0] and isinstance(arguments[0], str | os.PathLike):
            flags = arguments[2] if isinstance(arguments[2], int) else 0
            opened.append((now[0], os.fspath(arguments[0]), bool(flags & (os.O_WRONLY | os.O_RDWR))))

    def follow(event: dict[str, object]) -> None:
        now[0] = "" if event["message"] == "done" else str(event["stage"])

    sys.addaudithook(watch)
    workspace = run(street, tmp_path_factory.mktemp("runs") / "ws", DRAFT, reporter=follow)
    now[0] = ""
    return workspace


def results(root: Path) -> dict[str, bytes]:
    """Every file that a run leaves, but for times and places."""
    keep = ("surfels", "ground", "masks", "regions", "inpaint", "inpainted", "renders", "frames", "meshes", "instances")
    keep += ("provenance", "certainty")
    return {
        str(p.relative_to(root)): p.read_bytes()
        for name in keep
        for p in sorted((root / name).rglob("*"))
        if p.is_file()
    }


def test_the_time_left_is_told_of_the_whole_run(done: Workspace) -> None:
    events = done.events()
    (said,) = [e for e in events if "forecast" in e]
    assert said["message"].startswith("8 frames, ") and list(said["forecast"]["seconds"]) == [s.name for s in STAGES]
    left = [(e["stage"], e["left_s"]) for e in events if "left_s" in e]
    assert {name for name, _ in left} == {s.name for s in STAGES}
    assert left[0][1] >= 0.5 * sum(said["forecast"]["seconds"].values()) and left[-1] == ("report", 0)


def test_the_car_goes_and_the_street_continues(done: Workspace, street: Path) -> None:
    before = after = count = 0.0
    for i in range(8):
        truth = cv2.imread(str(street.parent / f"truth/images/{i:02d}.png")).astype(float)
        removed = cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0) > 0
        image = cv2.imread(str(street.parent / f"images/{i:02d}.png")).astype(float)
        clean = cv2.imread(str(done.root / f"frames/camera/{i:02d}.png")).astype(float)
        before += ((image - truth)[removed] ** 2).sum()
        after += ((clean - truth)[removed] ** 2).sum()
        count += 3 * removed.sum()
    assert count > 1000
    psnr = [10 * np.log10(255**2 / (e / count)) for e in (before, after)]
    methods = json.loads((done.root / "metrics.json").read_text())["truth"]["regions"]["removed"]["methods"]
    assert psnr[1] == pytest.approx(methods["ours"]["psnr"], abs=0.01) and psnr[1] > psnr[0] + 6, psnr
    # An average of the street would come near in PSNR, not in structure.
    for other in ("telea", "shift_map"):
        assert psnr[1] > methods[other]["psnr"] + 4 and methods["ours"]["ssim"] > methods[other]["ssim"] + 0.2, other


def test_the_empty_scene_holds_from_free_viewpoints(done: Workspace) -> None:
    """1.5 m beside the path and 1 m above it, where the drive never was."""
    metrics = json.loads((done.root / "metrics.json").read_text())
    free, recorded = metrics["free_views"]["regions"], metrics["truth"]["regions"]
    assert free["free_removed"]["psnr"] > recorded["removed"]["methods"]["input"]["psnr"] + 6
    assert metrics["free_views"]["below_recorded"]["free_removed"] < 3
    assert free["free_whole"]["psnr"] > 20


def test_nothing_else_changes(done: Workspace, street: Path) -> None:
    for i in range(8):
        image = cv2.imread(str(street.parent / f"images/{i:02d}.png"))
        clean = cv2.imread(str(done.root / f"frames/camera/{i:02d}.png"))
        mask = cv2.imread(str(done.root / f"masks/removed/camera/{i:02d}.png"), 0) > 0
        mask |= cv2.imread(str(done.root / f"masks/shadows/camera/{i:02d}.png"), 0) > 0
        assert np.array_equal(clean[~mask], image[~mask])


def test_every_pixel_tells_where_it_comes_from_and_how_sure_it_is(done: Workspace) -> None:
    def plane(folder: str, i: int) -> np.ndarray:
        return cv2.imread(str(done.root / f"{folder}/camera/{i:02d}.png"), cv2.IMREAD_UNCHANGED)

    ground = read_ground(done.ground_npz).street
    assert ground is not None
    chart = read_chart_sources(done.root / "inpaint/chart.npz")
    assert chart is not None
    invented_ground = []
    for i, frame in enumerate(read_imported(done.drive_dir).frames):
        origin, level = plane("provenance", i), plane("certainty", i)
        removed, unobserved = plane("masks/removed", i) > 0, plane("masks/unobserved", i) > 0
        changed = removed | (plane("masks/shadows", i) > 0)
        assert origin.dtype == level.dtype == np.uint8 and origin.shape == level.shape == changed.shape
        assert (origin[~changed] == 0).all() and (level[~changed] == 255).all()
        assert (np.isin(origin[changed], (1, 2, 3, 4))).all() and (level[changed] < 255).all()
        assert not unobserved[np.isin(origin, (1, 2))].any()
        # Well inside, what the ray meets is ground that the chart continued.
        core = cv2.erode((removed & unobserved).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        depth, street = ground.intersect(frame.camera, frame.camera.rays()[core])
        row = np.round((street[:, 0] - chart.s_start) / chart.texel).astype(int).clip(0, len(chart.source) - 1)
        column = np.round((street[:, 1] - chart.t_start) / chart.texel).astype(int).clip(0, chart.source.shape[1] - 1)
        met = np.isfinite(depth) & (np.abs(street[:, 1]) < 4) & (chart.source[row, column] == INVENTED)
        invented_ground.append(origin[core][met])
    found = np.concatenate(invented_ground)
    assert len(found) > 100 and (found == 3).mean() > 0.95
    metrics = json.loads((done.root / "metrics.json").read_text())
    assert sum(o["share"] for o in metrics["provenance"]["origins"].values()) == pytest.approx(1, abs=1e-3)
    assert 0 < metrics["certainty"]["expected"] < 1 and metrics["certainty"]["bins"]


def test_stages_read_and_write_what_they_declare(
    done: Workspace, street: Path, opened: list[tuple[str, str, bool]]
) -> None:
    drive, root = street.parent.resolve(), done.root.resolve()
    stages = {s.name: s for s in STAGES}
    reading: set[str] = set()
    wrong: set[str] = set()
    for name, path, writes in opened:
        where, stage = Path(path).resolve(), stages[name]
        if where.is_relative_to(root):
            inside = where.relative_to(root).as_posix()
            if inside.startswith(("workspace.json", "events.jsonl", ".")) and not inside.startswith(".partial-"):
                continue  # the runner's own
            if inside.startswith(".partial-"):
                right = Path(inside).parts[0] == f".partial-{name}"
            else:
                reading.add(name)
                right = not writes and depends_on([inside], stage.inputs)
        elif where.is_relative_to(drive):
            declared = () if stage.outside is None else stage.outside(done, DRAFT, street)
            right = not writes and where in {p.resolve() for _, p in declared}
        else:
            continue
        if not right:
            wrong.add(f"{name} {'writes' if writes else 'reads'} {path}")
    assert not wrong, "\n".join(sorted(wrong))
    assert reading == set(stages) - {"import"}


def test_the_workspace_is_complete(done: Workspace) -> None:
    for name in (
        "labels.json",
        "instances.json",
        "metrics.json",
        "surfels/full.ply",
        "surfels/empty.ply",
        "meshes/full.ply",
        "meshes/empty.ply",
        "meshes/empty.glb",
        "report/index.html",
        "events.jsonl",
        "inpaint/keyframes.json",
    ):
        assert (done.root / name).stat().st_size > 0, name
    (car,) = json.loads((done.root / "instances.json").read_text())
    assert car["id"] == 5 and car["class"] == "car" and car["removed"]
    # Only two sides of the car were ever seen; its middle is known to within a metre all the same.
    offset = json.loads((done.root / "drive/cameras.json").read_text())["to_world"]["translation"]
    assert np.abs(np.array(car["box"]["centre"])[:2] + offset[:2] - (10.75, -2.55)).max() < 1.0
    stages = done.state()["stages"]
    assert all(stage["status"] == "done" for stage in stages.values()) and len(stages) == len(STAGES)


def test_the_same_seed_gives_the_same_files_after_a_kill_too(done: Workspace, street: Path, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "unveil_core",
        "run",
        str(street),
        "-o",
        str(tmp_path / "ws"),
        "--quality",
        "draft",
    ]
    command += ["--iterations", str(STEPS), "--splats", str(SPLATS)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env={**os.environ})
    state = tmp_path / "ws" / "workspace.json"
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:  # kill it in the middle of a late stage
        if state.is_file() and '"inpaint"' in state.read_text():
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    again = run(street, tmp_path / "ws", DRAFT, until="mesh")
    first, second = results(done.root), results(again.root)
    assert first.keys() == second.keys() and len(first) > 40
    assert [n for n in first if first[n] != second[n]] == []
    events = [e for e in again.events() if e["message"] == "up to date"]
    assert {"import", "segment", "reconstruct"} <= {e["stage"] for e in events}


def test_another_choice_redoes_only_what_depends_on_it(done: Workspace, street: Path, tmp_path: Path) -> None:
    ran: list[str] = []
    shutil.copytree(done.root, tmp_path / "ws")
    run(
        street,
        tmp_path / "ws",
        replace(DRAFT, shadows="off"),
        until="inpaint",
        reporter=lambda e: ran.append(str(e["stage"])) if e["message"] == "started" else None,
    )
    assert "reconstruct" not in ran and "inpaint" in ran


def test_masks_on_some_frames_are_enough(tmp_path: Path) -> None:
    street = make_small_street(tmp_path / "street", masks_only=True)
    workspace = run(street, tmp_path / "ws", DRAFT, until="remove")
    ground = read_ground(workspace.ground_npz)
    assert json.loads((workspace.root / "ground/ground.json").read_text())["street_from"] == "level surfels"
    assert ground.street is not None and ground.terrain is None
    drive = read_imported(workspace.drive_dir)
    eye = ground.street.over(ground.path.to_street(np.stack([f.camera.centre for f in drive.frames])))
    assert np.abs(eye - 1.6).max() < 0.15
    for i in range(8):
        truth = cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0) > 0
        found = cv2.imread(str(workspace.root / f"masks/removed/camera/{i:02d}.png"), 0) > 0
        if truth.sum() > 60:
            assert (found & truth).sum() / truth.sum() > 0.6, i


def test_a_long_drive_tells_how_far_its_check_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before there is a workspace that could log it."""
    clock = iter(np.arange(0.0, 1e6, 0.6))
    watch = SimpleNamespace(monotonic=lambda: float(next(clock)), time=time.time)
    monkeypatch.setattr(run_module, "time", watch)
    events: list[dict[str, object]] = []
    run(make_tiny_drive(tmp_path / "drive"), tmp_path / "ws", until="import", reporter=events.append)
    early = events[: next(i for i, e in enumerate(events) if "placement" in e)]
    assert early and all(e["message"] == "checking files" and e["total"] == 4 for e in early)
    assert set(early[0]) == {"t", "stage", "done", "total", "message", "level"}
