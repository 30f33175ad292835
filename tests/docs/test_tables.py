"""Tables of the pages out of result files."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from docs.generate import PARTS, ROOT
from docs.tables.read import both, dated, mean_se, percent, results, seconds, table
from docs.tables.streets import ranges

MEASURED = [
    pytest.param(make, id=f"{page}: {name}")
    for page in ("../README.md", "benchmarks.md", "benchmarks_parts.md")
    for name, make in PARTS[page].items()
]


def test_cells() -> None:
    assert table(("a", "b"), [(1, None)]) == "| a | b |\n| --- | --- |\n| 1 | – |"
    assert both({"psnr": 24.16, "ssim": 0.759}) == "24.2 dB / 0.76"
    assert (percent(0.1252), percent(0.1252, 1)) == ("13 %", "12.5 %")
    assert (seconds(96.2), seconds(1546.3)) == ("96 s", "26 min")
    assert mean_se({"mean": 0.0123, "se": 0.004}, 1, 100, "+") == "+1.2 ± 0.4"


@pytest.mark.parametrize("make", MEASURED)
def test_tables_are_whole(make: Callable[[], str]) -> None:
    text = make()
    assert text and not re.search(r"\b(nan|inf|None)\b", text)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) <= 1


def test_rows_of_earlier_programs_say_so() -> None:
    def made(name: str) -> Callable[[], str]:
        return lambda: table(("a",), [(name if results(name) else "",)])

    assert dated(made("hard_cases")) == "| a | program |\n| --- | --- |\n| hard_cases | earlier |"
    assert dated(made("install")) == table(("a",), [("install",)])  # of packages alone
    assert dated(lambda: "No figure.") == "No figure."


def test_what_is_said_of_held_out_streets_is_counted() -> None:
    looks = [row for seed, row in results("streets")["first_looks"]["standard"].items() if int(seed) >= 28]
    found = sorted(row["removed"]["psnr"] for row in looks)
    assert ranges().startswith(
        f"Of the {len(found)} held-out streets {sum(value < 20 for value in found)} were below 20 dB"
    )
    assert f"The lowest had {found[0]:.1f} dB, the highest {found[-1]:.1f}" in ranges()


def test_the_readme_quotes_the_latest_run() -> None:
    street = next(run for run in results("sample_street")["runs"] if run["drive"] == "parked_street")["regions"][
        "removed"
    ]
    page = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert (
        f"{street['ours']['psnr']:.1f} dB PSNR" in page
        and f"frame by frame, has {street['shift_map']['psnr']:.1f} (" in page
    )
