"""Stage ``reconstruct``: surfels, sky and exposures from points and photographs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from unveil_core.base.resume.checkpoint import facts_array, facts_of
from unveil_core.drives.exposure import exposures_json, exposures_of_json, write_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.optimize.adaptation.choices import CHOICES
from unveil_core.optimize.exposure import fit_exposures
from unveil_core.optimize.ground_start import MEASURED
from unveil_core.optimize.in_blocks import BlockwiseReconstruction
from unveil_core.optimize.presets import PRESETS, ReconstructSettings
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.source_digest import code_digest
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.surfels.ply import write_surfels
from unveil_core.surfels.sky import save_sky
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import load_labels
from unveil_core.workspace.movers import read_moving

__all__ = ["asked_for", "reconstruct_with", "run", "run_block"]


def asked_for(settings: RunSettings) -> ReconstructSettings:
    """The quality's limits, and what the user has decided instead."""
    preset = PRESETS[settings.quality]
    given = {"iterations": settings.iterations, "sh_degree": settings.sh_degree, "budget": settings.splats}
    decided: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return replace(preset, **decided, given=frozenset(decided) if settings.adapt else frozenset(CHOICES))


def run(context: StageContext) -> Facts:
    """surfels/full.ply and surfels/sky.npz, in the canonical colours that surfels/exposure.json defines. Returns what was chosen
    and assumed."""
    return reconstruct_with(context, asked_for(context.settings))


def reconstruct_with(context: StageContext, settings: ReconstructSettings) -> Facts:
    """What :func:`run` does, with settings of one's own: for comparison."""
    work = _work(context, settings)
    done = work.whole()
    write_exposures(work.exposures, context.output("surfels/exposure.json"))
    comments = (f"labels {','.join(n.replace(' ', '_') for n in work.scene.labels.names)}",)
    write_surfels(done.surfels, context.output("surfels/full.ply"), to_world=work.drive.to_world, comments=comments)
    save_sky(done.sky, context.output("surfels/sky.npz"))
    work.parts.tidy()
    return {"choices": done.choices, **assumed([_sky_assumed(done.choices), *_ground_assumed(done.choices)])}


def _sky_assumed(choices: dict[str, Any]) -> Assumption:
    """That there is a sky, by where each block's sky began, or that of all."""
    told = _of_all(choices, "sky")
    shown, frames = (sum(t[name] for t in told) for name in ("shown", "frames"))
    found = f"in {shown} of {frames} frames" if shown else f"in none of {frames} frames"
    return Assumption("the sky is above", shown > 0, found, "an even grey is behind the scene before it is trained")


def _ground_assumed(choices: dict[str, Any]) -> list[Assumption]:
    """That a LiDAR measured the ground, by what each block began with, or all; nothing where no lane was seen."""
    told = [one for one in _of_all(choices, "ground") if one["measured"] is not None]
    if not told:
        return []
    least = min(told, key=lambda one: float(one["measured"]))
    found = f"points lie close together on {100 * least['measured']:.0f} % of the lane ahead"
    if least.get("told_by"):
        found += f"; the camera is {least['height']:.2f} m over it by the {least['told_by']}"
    instead = {
        "photographs": "the ground begins where photographs of it agree",
        "points": "the ground starts at the height of few points",
    }.get(least.get("told_by", ""), "no points show the ground before training")
    return [Assumption("a LiDAR measured the ground", least["measured"] > MEASURED, found, instead)]


def _of_all(choices: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """One of the choices as each block made it, or all together."""
    return [c[name] for c in (choices, *choices.get("blocks", [])) if c.get(name)]


def _work(context: StageContext, settings: ReconstructSettings) -> BlockwiseReconstruction:
    moving = read_moving(context.workspace.root)
    drive = moving.static_part(read_imported(context.workspace.drive_dir))
    hidden = moving.hidden(drive, context.cache)

    def exposures() -> dict[str, NDArray[Any]]:
        return {
            "exposures": facts_array(exposures_json(fit_exposures(drive, hidden=hidden, progress=context.progress)))
        }

    # Of the whole drive: fitted once, whichever block is made first.
    kept = facts_of(context.kept.once("exposures", exposures)["exposures"])
    blocks = cut_into_blocks(drive)
    return BlockwiseReconstruction(
        drive,
        load_labels(context.workspace),
        settings,
        blocks,
        exposures_of_json(kept),
        hidden,
        context.settings.seed,
        context.cache,
        context.kept,
        context.parts(len(blocks.blocks)),
        code_digest(run),
        context.progress,
    )


def run_block(context: StageContext, number: int) -> None:
    """One block of the drive, kept for the stage."""
    work = _work(context, asked_for(context.settings))
    if len(work.blocks.blocks) > 1:
        work.block(work.blocks.blocks[number])
