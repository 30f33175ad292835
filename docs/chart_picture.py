"""Makes the picture of a chart in docs/method.md: the ground as seen, where each texel has its colour from, and filled.

    python docs/chart_picture.py WORKSPACE [-o docs/pictures/chart.jpg]

The workspace is that of ``unveil demo``. The street runs from left to right, its left side on top.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from benchmarks.real_drives.fill_charts import open_street  # noqa: E402
from unveil_core import UnveilError, Workspace  # noqa: E402
from unveil_core.inpaint.by_stretch import StreetFill  # noqa: E402
from unveil_core.inpaint.chart.street_chart import StreetChart  # noqa: E402

WIDTH_PX = 1200
COLORS = np.array([[235, 235, 235], [120, 120, 120], [60, 130, 220], [240, 150, 40]], np.uint8)
"""By a chart's OUTSIDE, OBSERVED, RELIT and INVENTED."""
GAP_PX = 6


def from_above(chart: StreetChart, colors: NDArray[np.uint8]) -> Image.Image:
    """The texels (A, B, 3) of a chart, the street from left to right."""
    shown = np.where(chart.source[..., None] == 0, COLORS[0], colors)
    picture = Image.fromarray(np.ascontiguousarray(shown.transpose(1, 0, 2)[::-1]))
    return picture.resize((WIDTH_PX, round(picture.height * WIDTH_PX / picture.width)), Image.Resampling.LANCZOS)


def main() -> None:
    """Write the picture of a workspace."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("workspace", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "pictures" / "chart.jpg")
    options = parser.parse_args()
    try:
        with tempfile.TemporaryDirectory() as scratch:
            street = open_street(Workspace.open(options.workspace), Path(scratch), StreetFill)
            whole = (street.stretches[0].rows[0], street.stretches[-1].rows[1])
            seen = street.gathered(street._read_own, *whole)
            filled = street.gathered(street.fill(street.find_sun(), shadows=True).own, *whole)
    except UnveilError as error:
        raise SystemExit(str(error)) from None
    rows = [
        from_above(chart, colors)
        for chart, colors in (
            (seen, np.round(255 * np.clip(seen.color, 0, 1)).astype(np.uint8)),
            (filled, COLORS[filled.source]),
            (filled, np.round(255 * np.clip(filled.color, 0, 1)).astype(np.uint8)),
        )
    ]
    picture = Image.new("RGB", (WIDTH_PX, sum(r.height for r in rows) + GAP_PX * (len(rows) - 1)), "white")
    for k, row in enumerate(rows):
        picture.paste(row, (0, k * (row.height + GAP_PX)))
    options.output.parent.mkdir(parents=True, exist_ok=True)
    picture.save(options.output, quality=85)
    print(f"{options.output}: {picture.width} x {picture.height}, {options.output.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
