"""The stages in the order of their dependence, each with what it reads and writes.

What a stage computes is in its module of ``steps``, which is imported when it runs: to say what is up to date, to import a drive
or to choose what is removed nobody waits for PyTorch.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from unveil_core.pipeline.outside import (
    check_networks,
    check_segmenter,
    files_of_corrections,
    files_of_drive,
    files_of_marked,
    files_of_moving_marks,
    files_of_networks,
    files_of_truth,
)
from unveil_core.pipeline.settings import OF_DRIVES
from unveil_core.pipeline.stage import Stage

__all__ = ["STAGES"]


def later(step: str, name: str = "run") -> Callable[..., Any]:
    """A function of a module of ``steps``, which is imported when it is called, or before by its ``load()``."""
    module = f"{__package__}.steps.{step}"

    def call(*given: Any) -> Any:
        return getattr(import_module(module), name)(*given)

    # By its module a function's code is known, see ``source_digest``.
    call.__module__, call.__name__ = module, name
    call.load = partial(import_module, module)  # type: ignore[attr-defined]
    return call


STAGES: tuple[Stage, ...] = (
    Stage(
        "import",
        later("import_"),
        (),
        ("drive",),
        ("work_side", "quality", "scale", "camera_height", "up", *OF_DRIVES, "poses", "segmenter"),
        outside=files_of_drive,
        check=check_segmenter,
    ),
    Stage("objects", later("objects"), ("drive",), ("objects.json", "objects"), ("marked",), outside=files_of_marked),
    Stage(
        "segment",
        later("segment"),
        ("drive",),
        ("labels.json", "movers"),
        ("movers",),
        outside=files_of_moving_marks,
    ),
    Stage(
        "choose",
        later("choose"),
        ("drive", "objects.json"),
        ("selection.json",),
        ("remove", "instances", "marked"),
        outside=files_of_marked,
    ),
    Stage(
        "reconstruct",
        later("reconstruct"),
        inputs=("drive", "labels.json", "movers"),
        outputs=("surfels/full.ply", "surfels/sky.npz", "surfels/exposure.json"),
        settings=("quality", "seed", "iterations", "sh_degree", "splats", "adapt", "without"),
        run_block=later("reconstruct", "run_block"),
    ),
    Stage(
        "ground",
        later("ground"),
        inputs=("drive", "labels.json", "movers", "surfels/full.ply", "surfels/exposure.json"),
        outputs=("ground",),
        settings=("without",),
    ),
    Stage(
        "instances",
        later("instances"),
        inputs=("drive", "labels.json", "movers", "selection.json", "objects.json", "objects", "surfels/full.ply"),
        outputs=("instances.json", "instances", "surfels/instances.npy"),
        settings=("marked",),
        outside=files_of_marked,
    ),
    Stage(
        "remove",
        later("remove"),
        inputs=(
            "drive",
            "labels.json",
            "movers",
            "selection.json",
            "objects.json",
            "surfels/full.ply",
            "surfels/exposure.json",
            "surfels/instances.npy",
            "ground",
        ),
        outputs=("surfels/removal.npz", "masks/removed", "masks/unobserved", "regions"),
        settings=("marked", "per_object", "without"),
        outside=files_of_marked,
    ),
    Stage(
        "inpaint",
        later("inpaint"),
        inputs=(
            "drive",
            "labels.json",
            "selection.json",
            "movers",
            "surfels/full.ply",
            "surfels/sky.npz",
            "surfels/exposure.json",
            "surfels/removal.npz",
            "surfels/instances.npy",
            "ground",
            "masks/removed",
            "masks/unobserved",
        ),
        outputs=(
            "inpainted",
            "inpaint/keyframes.json",
            "inpaint/chart.npz",
            "inpaint/origins",
            "masks/shadows",
            "surfels/edit.npz",
        ),
        outside=files_of_networks,
        check=check_networks,
        settings=(
            "quality",
            "sh_degree",
            "shadows",
            "inpainter",
            "reference_inpainter",
            "order",
            "keyframes",
            "per_object",
            "without",
        ),
    ),
    Stage(
        "reoptimize",
        later("reoptimize"),
        inputs=(
            "drive",
            "labels.json",
            "movers",
            "surfels/full.ply",
            "surfels/sky.npz",
            "surfels/exposure.json",
            "surfels/edit.npz",
            "inpainted",
            "inpaint/origins",
            "ground",
            "masks/removed",
            "masks/shadows",
            "masks/unobserved",
        ),
        outputs=(
            "surfels/empty.ply",
            "renders",
            "depths",
            "clean",
            "provenance",
            "certainty",
        ),
        settings=("quality", "seed", "sh_degree", "inpainter", "corrections", "without"),
        outside=files_of_corrections,
        run_block=later("reoptimize", "run_block"),
    ),
    Stage(
        "deliver",
        later("deliver"),
        inputs=(
            "drive",
            "movers",
            "clean",
            "depths",
            "surfels/exposure.json",
            "ground",
            "inpaint/chart.npz",
            "masks/removed",
            "masks/shadows",
        ),
        outputs=("frames", "st_maps"),
        settings=("corrections", "without"),
        outside=files_of_corrections,
    ),
    Stage(
        "mesh",
        later("mesh"),
        inputs=("drive", "surfels/full.ply", "surfels/empty.ply"),
        outputs=("meshes/full.ply", "meshes/empty.ply", "meshes/empty.glb"),
        settings=("quality",),
    ),
    Stage(
        "report",
        later("report"),
        inputs=(
            "drive",
            "clean",
            "frames",
            "renders",
            "inpainted",
            "masks",
            "regions",
            "provenance",
            "certainty",
            "instances.json",
            "instances",
            "meshes/full.ply",
            "meshes/empty.ply",
            "meshes/empty.glb",
            "surfels/empty.ply",
            "surfels/sky.npz",
            "surfels/edit.npz",
        ),
        outputs=(
            "metrics.json",
            "report",
        ),
        settings=("baselines",),
        outside=files_of_truth,
    ),
)
"""All stages in the order of their dependence."""
