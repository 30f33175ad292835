"""The rows of the pipeline's benchmark: ours, and every baseline of the paper in our representation.

*3D StreetUnveiler* (ICLR 2025), table 1 and section 4, compares with single-image inpainting frame by frame, with video
inpainting, with inpainted radiance fields, and with its own variants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from unveil_core.base.errors import SettingsError
from unveil_core.base.progress import Progress
from unveil_core.base.types import Picture
from unveil_core.bench.rows import flow, reverse, runs, single_frames, splats
from unveil_core.bench.rows.footage import Footage

__all__ = ["ROWS", "Row", "chosen_rows"]

FRAMES = ("import", "segment", "choose")
SCENE = ("import", "objects", "segment", "choose", "reconstruct", "ground", "instances", "remove")


@dataclass(frozen=True)
class Row:
    """One way to an empty street.

    Attributes:
        title: how people call it.
        make: the frames that it delivers, one (H, W, 3) uint8 per frame of the drive.
        needs: stages of the pipeline that it builds on; their time and memory count for it.
        weights: what network it cannot do without, "inpainter", "reference", or "reference file" where a file must be named; None =
            it needs none.
    """

    title: str
    make: Callable[[Footage, Progress], list[Picture]]
    needs: tuple[str, ...]
    weights: str | None = None


ROWS: dict[str, Row] = {
    "input": Row("crowded frames", single_frames.untouched, ()),
    "telea": Row("Telea, frame by frame", single_frames.TELEA, FRAMES),
    "shift_map": Row("shift-map, frame by frame", single_frames.SHIFT_MAP, FRAMES),
    "per_frame": Row("single-image model, frame by frame", single_frames.per_frame, FRAMES),
    "network_per_frame": Row("network, frame by frame (LaMa, SDXL)", single_frames.per_frame, FRAMES, "inpainter"),
    "flow": Row("along optical flow (ProPainter)", flow.flow, FRAMES),
    "spin_nerf": Row("SPIn-NeRF in 2DGS", splats.spin_nerf, SCENE),
    "infusion": Row("Infusion", splats.infusion, SCENE),
    "reference_reverse": Row(
        "reference network, reversed (LeftRefill)", reverse.reference_reverse, FRAMES, "reference"
    ),
    "transfer_reverse": Row("later frame by depth, reversed (ours)", reverse.transfer_reverse, SCENE),
    "paper": Row("reversed in time, no charts (StreetUnveiler)", runs.ours("reverse", charts=False), SCENE),
    "paper_forward": Row("forward in time, no charts (time-forward)", runs.ours("forward", charts=False), SCENE),
    "paper_independent": Row("each frame for itself, no charts", runs.ours("independent", charts=False), SCENE),
    "paper_ellipsoids": Row("3D Gaussians, no charts (3DGS)", runs.ellipsoids(charts=False), FRAMES),
    "forward": Row("Unveil, forward in time", runs.ours("forward"), SCENE),
    "independent": Row("Unveil, each frame for itself", runs.ours("independent"), SCENE),
    "ellipsoids": Row("Unveil on 3D Gaussians", runs.ellipsoids(charts=True), FRAMES),
    "ours_by_reference": Row(
        "Unveil, carried by the reference network", runs.ours("reverse", by_reference=True), SCENE, "reference file"
    ),
    "ours": Row("Unveil", runs.ours("reverse"), SCENE),
}


def chosen_rows(names: tuple[str, ...]) -> dict[str, Row]:
    """The rows of these names, all without any.

    Raises:
        SettingsError: there is none of a name.
    """
    unknown = [name for name in names if name not in ROWS]
    if unknown:
        raise SettingsError(f"Not a row: {unknown[0]}", mend=f"use some of {', '.join(ROWS)}")
    return {name: row for name, row in ROWS.items() if not names or name in names}
