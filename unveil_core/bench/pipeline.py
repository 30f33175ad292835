"""Whole methods side by side on the same scene: quality inside the removed region against seconds."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.base.progress import Progress
from unveil_core.base.types import Picture
from unveil_core.bench.measure import measure_frames
from unveil_core.bench.plot import Point, quality_plot
from unveil_core.bench.rows import ROWS, Row, chosen_rows
from unveil_core.bench.rows.footage import Footage, open_footage
from unveil_core.bench.timing import forget_peak_memory, machine
from unveil_core.drives import open_drive
from unveil_core.evaluate.pictures import truth_file
from unveil_core.inpaint.frames.by_reference import ReferenceInpainter
from unveil_core.inpaint.single_image.names import INPAINTERS, is_file
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.pipeline.output_place import check_folder_place
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Reporter, silent
from unveil_core.workspace.files import frame_file

__all__ = ["bench_pipeline", "plot_points", "write_pipeline_plot"]

DONE, NEEDS_WEIGHTS = "done", "needs weights"
MEND = "name an empty folder with --keep"


def bench_pipeline(
    drive: Path,
    settings: RunSettings,
    *,
    rows: tuple[str, ...] = (),
    scene: Path | None = None,
    keep: Path | None = None,
    reference: ReferenceInpainter | None = None,
    reporter: Reporter = silent,
) -> dict[str, Any]:
    """Run rows on one drive and compare what they deliver with the true empty street.

    The scene is reconstructed once, and every row begins with it or with the masks alone; what a row builds on counts for it.

    Args:
        drive: with a truth (``truth/images``).
        settings: of the run: quality, seed, the single-image inpainter of all rows, what to remove.
        rows: names in ``ROWS``; all by default.
        scene: workspace of the reconstructed scene, made if need be and kept; a temporary one by default.
        keep: folder that gets the rows' frames, ``<row>/<camera>/<frame>.png``.
        reference: network of reference-based inpainting; by default the one that the settings name.
        reporter: receives the events of the scene's reconstruction, and of the rows as if they were stages.
    Returns:
        JSON-able: the machine, the scene's stages, and per row its status (``done`` or ``needs weights``), seconds in all and
        of the row alone, peak memory of both, and the figures of :func:`measure_frames`.
    Raises:
        SettingsError: no row is called so, or a network's file is none. WorkspaceError: the drive has no truth.
    """
    chosen = chosen_rows(rows)
    opened = open_drive(drive)
    if opened.truth_root is None or not any(truth_file(opened.truth_root / "images", f) for f in opened.frames):
        raise WorkspaceError(
            "has no true images of the empty street to compare with", path=drive, mend="put them into truth/images"
        )
    single_image = inpainter(settings.inpainter)
    if reference is None and "reference_inpainter" in settings.networks:
        reference = load_reference(settings.networks["reference_inpainter"])
    before = machine()
    if keep is not None:
        check_folder_place(keep, [drive])
    with tempfile.TemporaryDirectory() if scene is None else nullcontext() as folder:
        workspace = run(
            drive, Path(folder) / "scene" if folder else scene or "", settings, until="remove", reporter=reporter
        )
        stages = workspace.state()["stages"]
        footage = open_footage(workspace, drive, settings, single_image, reference)
        measured = []
        if keep is not None:
            with OwnFolder(keep, mend=MEND) as own:
                own.check(_kept_names(footage, chosen))
        for name, row in chosen.items():
            missing = _missing_weights(row, settings, reference)
            if missing:
                measured.append({"row": name, "title": row.title, "status": NEEDS_WEIGHTS, "mend": missing})
                reporter(_event(name, f"{NEEDS_WEIGHTS}: {missing}"))
                continue
            reporter(_event(name, "started"))
            frames, figures = _run_row(row, footage, stages, _speaking(name, reporter))
            reporter(_event(name, "done", 1, 1, seconds=figures["seconds"]))
            measured.append({"row": name, "title": row.title, "status": DONE, **figures})
            if keep is not None:
                _keep_frames(footage, frames, keep, name)
    return {
        "machine": before,
        "drive": (drive.parent if drive.suffix == ".json" else drive).name,
        "frames": len(footage.drive.frames),
        "size": [footage.drive.frames[0].camera.width, footage.drive.frames[0].camera.height],
        "quality": settings.quality,
        "seed": settings.seed,
        "inpainter": _named(settings.inpainter),
        "reference_inpainter": settings.reference_inpainter and _named(settings.reference_inpainter),
        "scene": {n: {k: s[k] for k in ("seconds", "peak_memory_mb")} for n, s in stages.items()},
        "rows": measured,
    }


def _missing_weights(row: Row, settings: RunSettings, reference: ReferenceInpainter | None) -> str | None:
    """What the user has to give for a row to run, None if nothing."""
    if row.weights == "inpainter" and settings.inpainter in INPAINTERS:
        return "give an ONNX file with --inpainter"
    given = {"reference": reference, "reference file": settings.reference_inpainter}
    if row.weights in given and given[row.weights] is None:
        return "give an ONNX file with --reference-inpainter"
    return None


def _named(setting: str) -> str:
    """A network by its file's name, wherever it lies."""
    return Path(setting).name if is_file(setting) else setting


def _event(name: str, message: str, done: int = 0, total: int = 0, **metrics: float) -> dict[str, object]:
    return {"stage": name, "done": done, "total": total, "message": message, "level": "info", **metrics}


def _speaking(name: str, reporter: Reporter) -> Progress:
    """A row's progress as events."""

    def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
        reporter(_event(name, message, done, total, **metrics))

    return progress


def _run_row(
    row: Row, footage: Footage, stages: Mapping[str, Mapping[str, Any]], progress: Progress
) -> tuple[list[Picture], dict[str, Any]]:
    forget_peak_memory()
    begun = time.perf_counter()
    frames = row.make(footage, progress)
    elapsed = time.perf_counter() - begun
    peaks = [peak_memory_mb(), *(float(stages[n].get("peak_memory_mb") or 0.0) for n in row.needs)]
    before = sum(float(stages[n].get("seconds", 0.0)) for n in row.needs)
    figures = {"seconds": round(before + elapsed, 2), "own_seconds": round(elapsed, 2), "peak_memory_mb": max(peaks)}
    return frames, figures | measure_frames(footage.drive, frames, footage.removed)


def _keep_frames(footage: Footage, frames: Sequence[Picture], keep: Path, row: str) -> None:
    with OwnFolder(keep, mend=MEND) as own:
        own.begin_anew()
        for name, picture in zip(_kept_names(footage, [row]), frames, strict=True):
            write_image_atomic(own.new / name, picture)
        own.exchange()


def _kept_names(footage: Footage, rows: Iterable[str]) -> list[str]:
    """Files of the rows' frames, relative to the folder that keeps them."""
    return [frame_file(Path(row), frame).as_posix() for row in rows for frame in footage.drive.frames]


def plot_points(measured: Sequence[Mapping[str, Any]]) -> list[Point]:
    """The rows of some runs as (name, seconds, decibels inside the removed region)."""
    points = []
    for one in measured:
        for row in one["rows"]:
            psnr = row.get("regions", {}).get("removed", {}).get("psnr")
            if psnr is not None and row["row"] != "input":
                title = ROWS[row["row"]].title if row["row"] in ROWS else row["title"]
                name = title if row["row"] != "ours" else f"{title}, {one['quality']}"
                points.append((name, float(row["seconds"]), float(psnr)))
    return points


def write_pipeline_plot(measured: Mapping[str, Any], path: Path) -> None:
    """Draw seconds against PSNR inside the removed region."""
    quality_plot(plot_points([measured]), path, title=f"{measured['drive'].replace('_', ' ')}, {measured['quality']}")
