"""The stages in the order of their dependence. Each declares what it reads and writes in its own module of ``steps``."""

from __future__ import annotations

from unveil_core.pipeline.stage import Stage
from unveil_core.pipeline.steps import (
    choose,
    deliver,
    ground,
    import_,
    inpaint,
    instances,
    mesh,
    objects,
    reconstruct,
    remove,
    reoptimize,
    report,
    segment,
)

__all__ = ["STAGES"]

STAGES: tuple[Stage, ...] = tuple(
    step.STAGE
    for step in (
        import_,
        objects,
        segment,
        choose,
        reconstruct,
        ground,
        instances,
        remove,
        inpaint,
        reoptimize,
        deliver,
        mesh,
        report,
    )
)
"""All stages in the order of their dependence."""
