"""XML is read item by item, and boxes move with the vehicle."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.drives.formats.kitti.files import rigid, rotation
from unveil_core.base.errors import DriveError
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.formats.kitti.boxes import LARGEST_ITEM_BYTES, moved, xml_items


def test_items_of_a_depth_come_one_by_one_with_what_they_hold(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text("<a>x<b>1<c>2</c></b> <b/><d at='1'>5 &lt; 6</d></a>")
    items = list(xml_items(path, 1))
    assert [(i.tag, i.text, i.findtext("c")) for i in items] == [
        ("b", "1", "2"),
        ("b", None, None),
        ("d", "5 < 6", None),
    ]
    assert [i.text for i in xml_items(path, 2)] == ["2"]


def test_long_files_are_read_in_parts(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text("<a>" + f"<b><c>{'7' * 50}</c></b>" * 50_000 + "</a>")
    assert sum(i.findtext("c") == "7" * 50 for i in xml_items(path, 1)) == 50_000


@pytest.mark.parametrize("text", ["<a><b></a></b>", "<a>", "<a>&undefined;</a>", "\0", "<a/><a/>"])
def test_damaged_files_say_so(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(text)
    with pytest.raises(DriveError, match=r"a.xml: Not complete XML"):
        list(xml_items(path, 1))
    path.unlink()
    with pytest.raises(DriveError, match="cannot be read"):
        list(xml_items(path, 1))


@pytest.mark.parametrize(
    "text",
    [
        "<!DOCTYPE boost_serialization>\n<a><b>1</b></a>",
        "<!DOCTYPE a []><a><b>1</b></a>",
        "<!DOCTYPE a [<!ELEMENT a ANY><!-- c -->]><a><b>1</b></a>",
    ],
)
def test_a_document_type_without_entities_is_borne(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(text)
    assert [i.text for i in xml_items(path, 1)] == ["1"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"<a><b>{'c' * LARGEST_ITEM_BYTES}</b></a>", "an element of more than 8 MiB"),
        (f"<a><b>{'<c/>' * (LARGEST_ITEM_BYTES // 4 + 8)}</b></a>", "an element of more than 8 MiB"),
        (f"<a><!--{'c' * (LARGEST_ITEM_BYTES + (2 << 20))}--></a>", "a tag of more than 8 MiB"),
        (f"<a b='{'c' * (LARGEST_ITEM_BYTES + (2 << 20))}'></a>", "a tag of more than 8 MiB"),
        ("<?xml version='1.0' encoding='rot13'?><a/>", "Not readable XML|Not complete XML"),
    ],
    ids=["text", "elements", "comment", "attribute", "encoding"],
)
def test_what_has_no_bounds_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(text)
    with pytest.raises(DriveError, match=said):
        list(xml_items(path, 1))


def test_boxes_move_with_the_vehicle() -> None:
    box = TrackedBox(3, "car", (10.0, 2.0, -1.0), (4.0, 2.0, 1.5), 0.2)
    found = moved(box, rigid(rotation(z=math.pi / 2), (100.0, 50.0, 5.0)))
    assert found.centre == pytest.approx((98, 60, 4)) and found.yaw == pytest.approx(0.2 + math.pi / 2)
    assert (found.id, found.class_name, found.size) == (3, "car", (4.0, 2.0, 1.5))
