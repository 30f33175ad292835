"""What later stages ask of the filled chart, on disk: ``inpaint/chart.npz`` of a workspace, arrays only.

source (A, B) uint8, see ``street_chart``; label (A, B) int16; place (3,) float64: s and t of the first texel, and the texel's side,
metres. Empty arrays where the street has no chart.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.array_headers import open_npz
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import NO_ARCHIVE, write_atomic

__all__ = ["ChartSources", "read_chart_sources", "save_chart"]


LARGEST_BYTES = 1 << 32
"""Of all arrays together: a hundred kilometres of street."""


@dataclass(frozen=True, eq=False)
class ChartSources:
    """Attributes:
    source: (A, B) uint8; label: (A, B) int16, as in ``street_chart.StreetChart``.
    s_start, t_start: street coordinates of the first texel; texel: its side, metres.
    """

    source: NDArray[np.uint8]
    label: NDArray[np.int16]
    s_start: float
    t_start: float
    texel: float


def save_chart(chart: ChartSources | None, path: Path) -> None:
    """Write where the chart's texels come from; ``None`` writes an empty one."""
    if chart is None:
        arrays = {"source": np.zeros((0, 0), np.uint8), "label": np.zeros((0, 0), np.int16), "place": np.zeros(3)}
    else:
        place = np.array([chart.s_start, chart.t_start, chart.texel])
        arrays = {"source": chart.source, "label": chart.label, "place": place}
    write_atomic(path, lambda stream: np.savez_compressed(stream, **arrays))  # type: ignore[arg-type]


def read_chart_sources(path: Path) -> ChartSources | None:
    """Read what :func:`save_chart` wrote; None where the street has no chart.

    Raises:
        WorkspaceError: it cannot be read.
    """
    try:
        with open_npz(path, ("source", "label", "place"), LARGEST_BYTES) as data:
            source, label, place = data["source"], data["label"], data["place"]
        if (source.dtype, label.dtype) != (np.uint8, np.int16) or place.dtype != np.float64:
            raise ValueError("arrays of other types")
        if source.shape != label.shape or source.ndim != 2 or place.shape != (3,) or not np.isfinite(place).all():
            raise ValueError("arrays of other shapes")
    except NO_ARCHIVE as error:
        raise WorkspaceError(f"Not a chart: {error}", path=path, mend="run `unveil inpaint` again") from error
    return ChartSources(source, label, *(float(v) for v in place)) if source.size else None
