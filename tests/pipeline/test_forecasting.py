"""What a run is expected to take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unveil_core.app.runs.whole_run import sample_drive
from unveil_core.drives import open_drive
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.pipeline.forecasting import expected_of_stages
from unveil_core.pipeline.settings import RunSettings


def test_finding_points_is_a_part_of_the_import() -> None:
    drive = open_drive(sample_drive())
    placement = place_drive(drive)
    bare = replace(drive, points=PointCloud(np.zeros((0, 3))), sweeps=())

    def seconds(of: object, *stages: str) -> dict[str, float]:
        found = expected_of_stages(of, placement, stages, RunSettings(), lambda _: None, keep=False)  # type: ignore[arg-type]
        return dict(found.forecast.seconds)

    given, found = (seconds(d, "import", "objects") for d in (drive, bare))
    assert found["import"] > given["import"] + 0.5
    assert found["objects"] == given["objects"] or abs(found["objects"] / given["objects"] - 1) < 0.5
    assert "import" not in seconds(bare, "objects")
