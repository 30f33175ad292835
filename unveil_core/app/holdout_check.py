"""The check on real footage: virtual cars over street that the photographs show, removed by an ordinary run, and measured.

There is no true empty street of a real drive. See :mod:`unveil_core.evaluate.holdout.drive` for what stands in its place.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from unveil_core.base.disk.rights import rights_of
from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.output.written import check_replaceable
from unveil_core.drives.imported import imported_files
from unveil_core.evaluate import METHODS
from unveil_core.evaluate.holdout.placement import find_places
from unveil_core.evaluate.holdout.planting import plant, read_scene
from unveil_core.evaluate.holdout.scores import References, measure_holdout, write_strips
from unveil_core.evaluate.perceptual import LpipsModel
from unveil_core.pipeline.output_place import check_folder_place, drives_of
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Reporter, silent
from unveil_core.report.wording import WAVELENGTHS, spectrum
from unveil_core.workspace.workspace import Workspace

__all__ = ["CARS", "MOST_CARS", "check_footage", "holdout_lines"]

CARS, MOST_CARS = 2, 9
FOLDER = "holdout"
"""All that a check makes lies in a folder of this name, in the one that the user names."""
MEND = "move it, or name another folder with -o"
SCRATCH = ".scene."
"""How the folder begins of what the scene shows in each frame, while the check runs."""
NEEDED = (
    "drive/cameras.json",
    "labels.json",
    "surfels/full.ply",
    "ground/ground.npz",
    "masks/removed",
    "masks/shadows",
)
COLUMNS = {"removed": "behind the cars", "seen_elsewhere": "seen elsewhere", "unseen": "never seen"}


def check_footage(
    source: str | Path,
    output: str | Path | None = None,
    *,
    cars: int = CARS,
    settings: RunSettings | None = None,
    quality: str | None = None,
    device: str | None = None,
    references: References | None = None,
    lpips: Path | None = None,
    reporter: Reporter = silent,
) -> dict[str, Any]:
    """Lay virtual cars over a drive, run everything on it, and compare with the photographs.

    Args:
        source: a finished workspace, or a drive, which is unveiled into ``OUTPUT/holdout/footage`` first.
        output: folder in which ``holdout/`` is made, with ``drive/`` with the cars, its ``workspace/``, ``cars/`` (whose pixel is
            whose), ``pictures/`` to look at and ``holdout.json``; beside a workspace, with ``_holdout`` appended, by default.
        cars: how many are wanted; where there is room for fewer, fewer.
        settings: of the run of a drive; a workspace brings its own.
        quality: of the run with the cars, if not that of the workspace; device: likewise, see ``RunSettings``.
        references: further methods that are measured beside the result.
        lpips: a network for LPIPS (see :class:`unveil_core.evaluate.perceptual.LpipsModel`), or None.
        reporter: receives each event.
    Returns:
        what :func:`unveil_core.evaluate.holdout.scores.measure_holdout` returns, with ``quality`` and ``seconds``.
    Raises:
        WorkspaceError: the workspace lacks a stage, or the street has no room for a car.
        SettingsError: the output is, holds or lies in a drive, is a workspace, or its ``holdout/`` is somebody's.
        UnveilError: bad input.
        Cancelled: SIGINT or SIGTERM; calling again goes on.
    """
    network = None if lpips is None else LpipsModel(lpips)
    if not 1 <= cars <= MOST_CARS:
        raise SettingsError(f"Out of range: {cars} virtual cars", mend=f"use 1 to {MOST_CARS}")
    source, given = Path(source), None
    if (source / "workspace.json").is_file():
        given = Workspace.open(source)
        _check_whole(given)
        place = source.with_name(f"{source.resolve().name}_holdout") if output is None else Path(output)
        drives = drives_of(given)
    else:
        if output is None:
            raise SettingsError("a drive needs a folder for the results", path=source, mend="name one with -o")
        given, place, drives = None, Path(output), [source]
    check_folder_place(place, drives)
    with OwnFolder(place / FOLDER, mend=MEND) as own:
        own.begin_anew()
        own.check(["holdout.json"])
        for name in ("workspace", "footage"):
            Workspace.may_be(own.root / name)
        check_replaceable(own.root / "drive", imported_files(own.root / "drive"), mend=MEND)
        # What a run would ask it says as a warning: this is a measurement, which has nobody to ask.
        footage = given or run(source, own.root / "footage", settings, until="inpaint", yes=True, reporter=reporter)
        with TemporaryDirectory(prefix=SCRATCH, dir=own.root) as scratch:
            return _checked(footage, own, cars, quality, device, references, network, reporter, Path(scratch))


def _check_whole(workspace: Workspace) -> None:
    missing = [n for n in NEEDED if not (workspace.root / n).exists()]
    if missing:
        raise WorkspaceError(
            f"has no {missing[0]}, which the check needs", path=workspace.root, mend="run `unveil run` on it first"
        )


def _checked(
    footage: Workspace,
    own: OwnFolder,
    cars: int,
    quality: str | None,
    device: str | None,
    references: References | None,
    lpips: LpipsModel | None,
    reporter: Reporter,
    scratch: Path,
) -> dict[str, Any]:
    """The check itself, see :func:`check_footage`; ``own``: for all that is made, ``scratch``: for what is gone afterwards."""
    started = time.monotonic()
    recorded = RunSettings.from_json(footage.state().get("settings", {}))
    cache = FrameCache(recorded.memory_bytes)
    progress = _progress(reporter)
    scene = read_scene(footage, cache, scratch, progress)
    placed = find_places(
        scene.street, scene.surfels, scene.drive.points.positions, scene.views.frames, count=cars, progress=progress
    )
    frames_of = [f"{f.camera_name}/{f.name}.png" for f in scene.drive.frames]
    strips = [f"pictures/{f.camera_name}_{f.name}.png" for f in scene.drive.frames]
    own.check([*(f"cars/{name}" for name in frames_of), *strips])
    planted = plant(scene, placed, own.root / "drive", own.new / "cars", cache, progress)
    drive, added = planted.drive, planted.labels
    ids = tuple(range(added.first_instance or 0, (added.first_instance or 0) + len(placed)))
    chosen = replace(
        recorded.without_drive_options(),
        quality=quality or recorded.quality,
        device=device or recorded.device,
        # The images are what they are to be already.
        work_side=max(32, *(max(f.camera.width, f.camera.height) for f in drive.frames)),
        instances=(*recorded.instances, *ids) if added.choose_instances else recorded.instances,
    )
    # The drive with the cars is of this folder alone, as its workspace is: with other cars it is another drive.
    workspace = run(
        own.root / "drive", own.root / "workspace", chosen, until="deliver", replace=True, yes=True, reporter=reporter
    )
    found = measure_holdout(
        planted.frames, placed, drive, workspace.root, references=references, lpips=lpips, progress=_progress(reporter)
    )
    write_strips(planted.frames, placed, drive, workspace.root, own.new / "pictures")
    found |= {"quality": chosen.quality, "seconds": round(time.monotonic() - started, 1)}
    write_json_atomic(own.new / "holdout.json", found)
    own.exchange(rights=rights_of([own.root / "drive/images"]))
    return found


def _progress(reporter: Reporter) -> Callable[..., None]:
    """Progress as events of a stage of its own, as the pipeline's stages report theirs."""
    last = [0.0]

    def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
        now = time.monotonic()
        if done >= total or now - last[0] > 0.2:
            last[0] = now
            reporter(
                {
                    "t": round(time.time(), 3),
                    "stage": "holdout",
                    "done": done,
                    "total": total,
                    "message": message,
                    "level": "info",
                    **metrics,
                }
            )

    return progress


def holdout_lines(found: dict[str, Any]) -> list[str]:
    """What :func:`check_footage` found, for the terminal."""
    columns = [c for c in COLUMNS if c in found["regions"]]
    lines = [f"  {'PSNR / SSIM to the photographs':<38}" + "".join(f"{COLUMNS[c]:>18}" for c in columns)]
    for method, name in METHODS.items():
        scores = [found["regions"][c]["methods"].get(method) for c in columns]
        if any(scores):
            cells = (f"{_decibels(s['psnr'])} / {s['ssim']:.3f}" if s else "-" for s in scores)
            lines.append(f"    {name:<36}" + "".join(f"{cell:>18}" for cell in cells))
    measured = [(c, found["regions"][c]["methods"]) for c in columns]
    if any("lpips" in row for _, methods in measured for row in methods.values()):
        lines.append("  LPIPS in crops around the cars, mean over cars")
        for method, name in METHODS.items():
            distances = [methods.get(method, {}).get("lpips") for _, methods in measured]
            if any(d is not None for d in distances):
                near = ("-" if d is None else f"{d:.3f}" for d in distances)
                lines.append(f"    {name:<36}" + "".join(f"{cell:>18}" for cell in near))
    for car in found["cars"]:
        side = "left" if car["left_m"] > 0 else "right"
        own = ", ".join(f"{METHODS[m]} {_decibels(p)}" for m, p in car["psnr"].items() if m in METHODS)
        lines.append(f"  car {car['number']}, {car['along_m']:.0f} m along, {abs(car['left_m']):.1f} m {side}: {own}")
    flicker = found["flicker"].get("methods", {})
    if flicker:
        names = {"truth": "the photographs", **METHODS}
        parts = (f"{name} {flicker[m]['absolute']:.1f}" for m, name in names.items() if m in flicker)
        lines.append(f"  flicker, levels of 255: {', '.join(parts)}")
    gradients = {m: share for m, share in found.get("gradient", {}).items() if m in METHODS and share is not None}
    shares = [f"{METHODS[m]} {share:.2f}" for m, share in gradients.items()]
    lines.append(f"  gradient inside, as a share of the photographs': {', '.join(shares)}")
    if bands := spectrum({name: found.get(name, {}).get("ours") for name in WAVELENGTHS}):
        lines.append(f"  spectrum inside, as a share of the photographs': {bands}")
    recall, false = found["line_recall"], found["false_lines"]
    found_lines = [f"{METHODS[m]} {_percent(recall[m])} / {_percent(false[m])}" for m in recall if m in METHODS]
    lines.append(f"  lines on the ground found / false: {', '.join(found_lines)}")
    if "full_size" in found:
        full = found["full_size"]
        lines.append(
            f"  at the footage's size: {_decibels(full['psnr'])}, gradient {full['gradient']:.2f}, "
            f"{full['changed_pixels']:.0f} pixels changed elsewhere"
        )
    lines.append(f"  changed where nothing should: {100 * found['outside']['changed']:.2f} % of the pixels")
    return lines


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def _decibels(value: float | None) -> str:
    return "exact" if value is None else f"{value:.1f} dB"
