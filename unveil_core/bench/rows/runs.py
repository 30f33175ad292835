"""Rows that are the pipeline itself: in its own order, in others, on 3D Gaussians instead of discs, and without street charts,
which are not the paper's."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress
from unveil_core.base.types import Picture
from unveil_core.bench.rows.footage import Footage
from unveil_core.pipeline.run import stage_named
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.stage import Facts, Stage, StageContext
from unveil_core.pipeline.steps.inpaint import inpaint_with
from unveil_core.pipeline.steps.reconstruct import asked_for, reconstruct_with
from unveil_core.workspace.files import frame_file
from unveil_core.workspace.workspace import Workspace

__all__ = ["ellipsoids", "ours"]


def ours(
    order: str, *, by_reference: bool = False, charts: bool = True
) -> Callable[[Footage, Progress], list[Picture]]:
    """A row of the pipeline with frames filled in an order, see ``RunSettings.order``.

    Args:
        by_reference: whether the network with a reference carries what was invented, not the surfels alone.
        charts: whether the street is known before anything is invented, see :func:`inpaint_with`; the paper's method has none.
    """

    def run(footage: Footage, progress: Progress) -> list[Picture]:
        network = footage.settings.reference_inpainter if by_reference else None
        wanted = replace(footage, settings=replace(footage.settings, order=order, reference_inpainter=network))
        return _frames_of(wanted, (), [_inpaint(charts), stage_named("reoptimize")], progress)

    return run


def ellipsoids(*, charts: bool) -> Callable[[Footage, Progress], list[Picture]]:
    """The pipeline on a scene of 3D Gaussians (*3D Gaussian Splatting*, 2023), reconstructed with the same losses.

    Args:
        charts: see :func:`ours`.
    """

    def run(footage: Footage, progress: Progress) -> list[Picture]:
        # Another version of the stage: the workspace's own reconstruction is not its result.
        other = replace(stage_named("reconstruct"), run=_reconstruct_ellipsoids, variant="ellipsoids")
        after = [
            *(stage_named(n) for n in ("ground", "instances", "remove")),
            _inpaint(charts),
            stage_named("reoptimize"),
        ]
        wanted = replace(footage, settings=replace(footage.settings, reference_inpainter=None))
        without = ("surfels", "ground", "masks", "regions", "instances", "instances.json")
        return _frames_of(wanted, without, [other, *after], progress)

    return run


def _inpaint(charts: bool) -> Stage:
    stage = stage_named("inpaint")
    return stage if charts else replace(stage, run=partial(inpaint_with, charts=False), variant="no charts")


def _reconstruct_ellipsoids(context: StageContext) -> Facts:
    return reconstruct_with(context, replace(asked_for(context.settings), ellipsoids=True))


def _frames_of(footage: Footage, without: Sequence[str], stages: Sequence[Stage], progress: Progress) -> list[Picture]:
    """The clean frames, of working size, that stages make in a copy of the workspace.

    Args:
        without: files and folders that the copy does not get.
    """
    turns = {stage.name: k for k, stage in enumerate(stages)}
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "workspace"
        root, left_out = footage.workspace.root, {".lock", *without}
        shutil.copytree(root, copy, ignore=lambda at, names: left_out & set(names) if Path(at) == root else ())
        run_stages(
            Workspace.open(copy),
            stages,
            footage.settings,
            footage.source,
            reporter=lambda e: progress(turns[str(e["stage"])], len(stages), str(e["stage"])),
        )
        progress(len(stages), len(stages), "done")
        return [read_image(frame_file(copy / "clean", f)) for f in footage.drive.frames]
