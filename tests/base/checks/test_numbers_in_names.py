"""Numbers in names count as numbers."""

from __future__ import annotations

import pytest

from unveil_core.base.checks.numbers_in_names import columns_of, counting_numbers, name_orders, natural_key


def test_numbers_sort_as_numbers() -> None:
    names = ["frame10", "frame2", "frame02", "Frame1", "a100b2", "a20b10", "a20b9", "", "x"]
    assert sorted(names, key=natural_key) == [
        "",
        "a20b9",
        "a20b10",
        "a100b2",
        "Frame1",
        "frame02",
        "frame2",
        "frame10",
        "x",
    ]


def test_numbers_of_any_length_sort() -> None:
    huge = ["9" * 5000, "1" + "0" * 5000, "08"]
    assert sorted(huge, key=natural_key) == ["08", "9" * 5000, "1" + "0" * 5000]


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["frame10", "frame2"], [10, 2]),
        (["0007", "0008"], [7, 8]),
        (["cam1_0002", "cam1_0010"], [2, 10]),
        (["x7"], [7]),
        (["cam1_2", "cam2_3"], None),  # two of them differ
        (["left_1", "right_2"], None),
        (["a", "b"], None),
        (["1" * 30, "2" * 30], None),
        ([], None),
    ],
)
def test_the_number_by_which_names_count(names: list[str], numbers: list[int] | None) -> None:
    assert counting_numbers(names) == numbers


def test_names_that_are_built_differently_have_no_columns() -> None:
    assert columns_of(["a1b2", "a1"]) is None
    assert columns_of(["a1b2", "c3d4"]) == [("a", "1", "b", "2", ""), ("c", "3", "d", "4", "")]


def orders(names: list[str]) -> dict[str, list[str]]:
    return {told: [names[i] for i in order] for told, order in name_orders(names)}


def test_orders_in_which_names_can_be_meant() -> None:
    found = orders(["f2", "f-2", "f-10", "f1"])
    assert found["the signed numbers in their names"] == ["f-10", "f-2", "f1", "f2"]
    found = orders(["0.1", "0.15", "0.2"])
    assert found["the decimal numbers in their names"] == ["0.1", "0.15", "0.2"]
    found = orders(["s91_f2", "s3_f10", "s7_f1"])
    assert found["the second number in their names"] == ["s7_f1", "s91_f2", "s3_f10"]


def test_orders_that_are_the_same_are_given_once() -> None:
    assert list(orders(["a01", "a02", "a10"])) == ["their names"]
    assert list(orders(["a1", "a2", "a10"])) == ["the numbers in their names", "their names as texts"]
