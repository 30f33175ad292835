"""Boxes of KITTI: the tracklets of a raw drive, and the boxes of KITTI-360. Both are XML, which is read item by item.

Facts: KITTI's readme and its tracklet devkit; autonomousvision/kitti360Scripts (``helpers/annotation.py``, ``labels.py``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox

__all__ = ["moved", "read_boxes_360", "read_tracklets", "xml_items"]

MEND = "download it again"
LARGEST_BYTES = 1 << 30
"""The longest XML file that is read: that of the longest sequence of KITTI-360 is far below it."""
DEEPEST = 24
"""Elements within one another at most; tracklets have 6."""
LARGEST_ITEM_BYTES = 8 << 20
"""The longest element that is kept, and the longest tag or comment: a tracklet through the longest drive takes 3 MB."""
TRACKLET_CLASSES = {
    "Car": "car",
    "Van": "car",
    "Truck": "truck",
    "Tram": "train",
    "Pedestrian": "person",
    "Person (sitting)": "person",
    "Person_sitting": "person",
    "Cyclist": "rider",
}
"""Cityscapes classes of tracklets. A cyclist's box holds the bicycle as well. "Misc" stays in the street."""
CLASSES_360: dict[int, tuple[int, str]] = {
    13: (26, "car"), 14: (27, "truck"), 15: (30, "truck"), 16: (29, "truck"), 17: (32, "motorcycle"), 18: (33, "bicycle"),
    19: (24, "person"), 20: (25, "rider"), 33: (31, "train"), 34: (28, "bus"), 36: (43, "car"),
}  # fmt: skip
"""Of the boxes of KITTI-360, by their number: the id that its pictures have for the class, and the Cityscapes class. 15, 16 and 36
are trailer, caravan and unknown vehicle."""
SPARE_IDS = 45000
"""Ids from here on are free: those of the pictures end at 44999."""


def xml_items(path: Path, depth: int, *, attributes: bool = False) -> Iterator[ElementTree.Element]:
    """The elements at a depth of an XML file, root 0, one after the other; none is kept. Attributes only where they are asked for.

    A document type that only names the root is usual: boost writes one into tracklets. One that declares entities or values of
    attributes, or that names another file, is refused: a few bytes would stand for many, or for what lies elsewhere.

    Raises:
        DriveError: missing, too large, too deep, damaged, or with such a document type.
    """
    builder, done = ElementTree.TreeBuilder(), list[ElementTree.Element]()
    level = begin = 0

    def doctype(_name: str, system: str | None, public: str | None, _subset: int) -> None:
        if system is not None or public is not None:
            raise DriveError("names another file as its document type, which data need not", path=path, mend=MEND)

    def entity(*_: object) -> int:
        raise DriveError("declares entities in its document type, which data need not", path=path, mend=MEND)

    def attribute(_element: str, _name: str, _kind: str, default: str | None, _required: int) -> None:
        if default is not None:
            raise DriveError("declares values in its document type, which data need not", path=path, mend=MEND)

    def start(tag: str, given: dict[str, str]) -> None:
        nonlocal level, begin
        if level > DEEPEST:
            raise DriveError(f"has more than {DEEPEST} elements within one another", path=path, mend=MEND)
        if level == depth:
            begin = parser.CurrentByteIndex
        if level >= depth:
            bounded()
            builder.start(tag, given if attributes else {})
        level += 1

    def end(tag: str) -> None:
        nonlocal level, builder
        level -= 1
        if level >= depth:
            builder.end(tag)
        if level == depth:
            done.append(builder.close())
            builder = ElementTree.TreeBuilder()

    def text(content: str) -> None:
        if level > depth:
            bounded()
            builder.data(content)

    def bounded() -> None:
        if parser.CurrentByteIndex - begin > LARGEST_ITEM_BYTES:
            raise DriveError(f"has an element of more than {LARGEST_ITEM_BYTES >> 20} MiB", path=path, mend=MEND)

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler, parser.AttlistDeclHandler = doctype, attribute
    parser.EntityDeclHandler = parser.ExternalEntityRefHandler = parser.SkippedEntityHandler = entity
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise DriveError(f"Too large: more than {LARGEST_BYTES >> 20} MiB", path=path, mend=MEND)
        with open_file(path, LARGEST_BYTES) as stream:
            while chunk := stream.read(1 << 20):
                parser.Parse(chunk, False)
                yield from done
                done.clear()
                if stream.tell() - parser.CurrentByteIndex > LARGEST_ITEM_BYTES:  # it waits for the end of a tag
                    raise DriveError(f"has a tag of more than {LARGEST_ITEM_BYTES >> 20} MiB", path=path, mend=MEND)
        parser.Parse(b"", True)
        yield from done
    except expat.ExpatError as error:
        raise DriveError(f"Not complete XML: {error}", path=path, mend=MEND) from error
    except (ValueError, LookupError, UnicodeError) as error:  # an encoding that Python does not know, or cannot use
        raise DriveError(f"Not readable XML: {error}", path=path, mend=MEND) from error
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend=MEND) from error


def _text(item: ElementTree.Element, name: str) -> str:
    found = item.findtext(name)
    if found is None:
        raise ValueError(f"lacks {name}")
    return found.strip()


def moved(box: TrackedBox, pose: Float64) -> TrackedBox:
    """A box in other coordinates, whose z is nearly up, too.

    Args:
        pose: (4, 4) from the box's coordinates to those.
    """
    x, y, z = (float(v) for v in pose[:3, :3] @ box.centre + pose[:3, 3])
    along = pose[:3, :3] @ (math.cos(box.yaw), math.sin(box.yaw), 0.0)
    return TrackedBox(box.id, box.class_name, (x, y, z), box.size, math.atan2(along[1], along[0]))


def read_tracklets(path: Path) -> dict[int, tuple[TrackedBox, ...]]:
    """Boxes in scanner coordinates by frame number, of a tracklet_labels.xml.

    Raises:
        DriveError: it cannot be read, or an object lacks something.
    """
    frames: dict[int, list[TrackedBox]] = {}
    objects = (item for item in xml_items(path, 2) if item.tag == "item")
    for number, item in enumerate(objects, 1):
        try:
            class_name = TRACKLET_CLASSES.get(_text(item, "objectType"))
            height, width, length = (float(_text(item, n)) for n in "hwl")
            first = int(_text(item, "first_frame"))
            poses = [[float(_text(p, n)) for n in ("tx", "ty", "tz", "rz")] for p in item.iterfind("poses/item")]
        except ValueError as error:
            raise DriveError(f"object {number}: {error}", path=path, mend=MEND) from error
        if class_name is None or not all(0 < s < math.inf for s in (length, width, height)):
            continue
        for frame, (x, y, z, yaw) in enumerate(poses, first):
            if all(math.isfinite(v) for v in (x, y, z, yaw)):
                # Theirs is the middle of the underside.
                centre = (x, y, z + height / 2)
                frames.setdefault(frame, []).append(
                    TrackedBox(number, class_name, centre, (length, width, height), yaw)
                )
    return {frame: tuple(boxes) for frame, boxes in frames.items()}


Boxes360 = tuple[dict[int, TrackedBox], dict[int, dict[int, TrackedBox]]]
"""Static boxes by id, and dynamic ones by id and frame number."""


def read_boxes_360(path: Path) -> Boxes360:
    """Boxes of a sequence of KITTI-360 in its world. Ids are those of its instance pictures: class id * 1000 + number.

    Raises:
        DriveError: it cannot be read, or an object lacks something.
    """
    try:
        state = path.stat()
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend=MEND) from error
    return _boxes_360(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=2)  # a drive is opened several times a run, and this is by far the longest file to read
def _boxes_360(path: Path, _changed: int, _size: int) -> Boxes360:
    fixed: dict[int, TrackedBox] = {}
    dynamic: dict[int, dict[int, TrackedBox]] = {}
    spare: dict[tuple[int, int], int] = {}
    for item in xml_items(path, 1):
        try:
            kind = CLASSES_360.get(int(_text(item, "semanticId")))
            if kind is None:
                continue
            instance, frame = int(_text(item, "instanceId")), int(_text(item, "timestamp"))
            number = kind[0] * 1000 + instance
            if not 0 < instance < 1000:  # the pictures cannot have it
                number = spare.setdefault((kind[0], instance or -1 - len(spare)), SPARE_IDS + len(spare))
            box = _oriented(number, kind[1], _matrix(item, "transform", 4), _matrix(item, "vertices", 3))
        except ValueError as error:
            raise DriveError(f"{item.tag}: {error}", path=path, mend=MEND) from error
        if box is None or number > 65535:
            continue
        if frame < 0:
            fixed.setdefault(number, box)
        else:
            dynamic.setdefault(number, {})[frame] = box
    return fixed, {n: dict(sorted(frames.items())) for n, frames in dynamic.items()}


def _matrix(item: ElementTree.Element, name: str, columns: int) -> Float64:
    values = np.array([float(word) for word in _text(item, f"{name}/data").split()])
    if not len(values) or len(values) % columns:
        raise ValueError(f"not a matrix of {columns} columns: {name}")
    return values.reshape(-1, columns)


def _oriented(number: int, class_name: str, transform: Float64, vertices: Float64) -> TrackedBox | None:
    """The upright box around vertices (V, 3) that a transform (4, 4), scale included, brings to the world; None = no box."""
    if transform.shape != (4, 4):
        raise ValueError("not a 4x4 matrix: transform")
    axes = transform[:3, :3]
    stretch = np.linalg.norm(axes, axis=0)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    sizes = stretch * (high - low)
    if not np.isfinite(transform).all() or not np.isfinite(sizes).all() or sizes.min() <= 0:
        return None
    upright = int(np.abs(axes[2] / stretch).argmax())
    length, width = sorted((k for k in range(3) if k != upright), key=lambda k: -sizes[k])
    x, y, z = (float(v) for v in axes @ ((low + high) / 2) + transform[:3, 3])
    size = (float(sizes[length]), float(sizes[width]), float(sizes[upright]))
    return TrackedBox(number, class_name, (x, y, z), size, math.atan2(axes[1, length], axes[0, length]))
