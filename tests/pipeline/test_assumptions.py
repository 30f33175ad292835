"""Assumptions as stages record them."""

from __future__ import annotations

from unveil_core.workspace.assumptions import Assumption, assumed, recorded_assumptions


def test_what_a_stage_records_is_read_back() -> None:
    one = Assumption("the sun shines", False, "no direction", "dark patches count")
    assert recorded_assumptions({"inpaint": assumed([one]), "mesh": {"assumptions": [{"odd": 1}]}, "x": 3}) == [
        ("inpaint", one)
    ]
    assert one.message() == "not so: the sun shines (no direction); dark patches count"
