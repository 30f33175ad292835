"""Labels of photographs by a segmentation network that the user brings as an ONNX file.

What the network takes and gives is found from the file, by running it once on noise; ``FILE.toml`` beside it says what cannot be
found (see :mod:`unveil_core.labelling.networks.settings`). An image is made so small that it just covers the network's window,
keeping its proportions, and is seen through overlapping windows where it is longer; the scores of the windows are blended. So a
network with a square input sees a street at the scale and with the proportions that it was trained for, and not squeezed into
a square. YOLO sees the image whole, as it was trained.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.frame_cache import Frames
from unveil_core.base.networks.onnx_files import files_of
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Float32, Picture
from unveil_core.drives.cityscapes import CITYSCAPES, VOID, train_id
from unveil_core.drives.drive import Drive, FrameLabels
from unveil_core.drives.importing.frames import labels_at_work_size
from unveil_core.drives.photographs import seen_footage
from unveil_core.labelling.networks.class_tables import (
    BY_COUNT,
    ORDERS,
    order_targets,
    removable,
    targets_of,
)
from unveil_core.labelling.networks.dense import NO_LABEL, Dense, OutputProblem, enlarged, find_dense, looks_like_detr
from unveil_core.labelling.networks.network import PictureNetwork
from unveil_core.labelling.networks.settings import NetworkSettings, read_settings, settings_path
from unveil_core.labelling.networks.windows import best_at_size, blended
from unveil_core.labelling.networks.yolo import Yolo, find_yolo, segment_objects

__all__ = ["NO_LABELS_HELP", "Segmenter", "label_by_network", "load_segmenter", "segmenter_files"]

NO_LABELS_HELP = (
    "The drive has no semantics, masks or boxes, so nothing says what can be removed. Give one of these: "
    "(1) --segmenter FILE.onnx, a segmentation network of your own exported to ONNX, as a SegFormer trained on Cityscapes or a "
    "YOLO-seg model; (2) masks of what to remove, 8-bit PNGs of the size of the images, 0 = remove, named by mask_path in "
    "transforms.json or lying as masks/NAME.png beside COLMAP's images/; some frames are enough; (3) images of Cityscapes "
    "trainIds, named by semantic_path; (4) unveil mask DRIVE -o masks --click FRAME:X,Y, which outlines in all frames what you "
    "click in one; (5) boxes of objects, in the drive or in --marked FILE.json, where folders of mattes can stand as well; "
    "--instances then chooses among them."
)
"""How to get labels, one paragraph: a message, and in the documentation."""
WINDOW_PX = (1024, 1024)
"""What a network of free size is shown at most, height and width: the crop that Cityscapes networks are mostly trained with, and a
size whose attention fits into memory."""


@dataclass(frozen=True)
class Segmenter:
    """A segmentation network, ready to run.

    Attributes:
        path: of the ONNX file.
        summary: what was found out about it, one line.
        whole_street: it names street and buildings, too; False: removable classes only, and all else is void.
        has_instances: it separates objects. Their ids are of one frame each: the same object has another id in the next.
    """

    path: Path
    summary: str
    whole_street: bool
    has_instances: bool
    _label: Callable[[Picture], FrameLabels]

    def segment(self, image: Picture) -> FrameLabels:
        """Labels of an image (H, W, 3) uint8 RGB, at its own size.

        Raises:
            SettingsError: the network fails, or gives what it did not give when it was loaded.
        """
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
            raise ValueError(f"an image must be (H, W, 3) uint8, not {image.shape} {image.dtype}")
        return self._label(image)


def label_by_network(drive: Drive, path: Path) -> Sequence[FrameLabels]:
    """Labels of each frame of an imported drive, found when they are asked for, by the network in a file.

    The network sees the footage at its own size and in its own lens: what is thin or far is gone from a picture of working size.

    Returns:
        by frame, of working size.
    Raises:
        SettingsError: see :func:`load_segmenter`. DriveError: an image that cannot be read.
    """
    segmenter, frames = load_segmenter(path), drive.frames

    def of_frame(i: int) -> FrameLabels:
        frame = frames[i]
        if frame.footage is None:
            return segmenter.segment(read_image(frame.image_path))
        return labels_at_work_size(frame.footage, segmenter.segment(seen_footage(frame.footage)), frame.camera)

    return Frames(len(frames), of_frame)


def segmenter_files(path: Path) -> list[Path]:
    """The files that the labels depend on: the network, weights beside it, and its settings."""
    settings = settings_path(path)
    return [*files_of(path), *([settings] if settings.is_file() else [])]


def load_segmenter(path: Path, *, threads: int | None = None) -> Segmenter:
    """Open a segmentation network and run it once on noise, to find out what it gives.

    Args:
        path: the ONNX file. ``FILE.toml`` beside it is read.
        threads: how many compute one run; None = one per core, and then labels of a few pixels on borders may differ between
            machines of different numbers of cores.
    Raises:
        SettingsError: a file is missing or damaged, or this is no segmentation network that can be used.
    """
    path = Path(path)
    settings = read_settings(path)
    network = PictureNetwork(path, settings, threads=threads)
    given, answers = network.try_it()
    if settings.output is not None:
        answers = {name: a for name, a in answers.items() if name == settings.output or settings.kind == "yolo"}
    names = settings.classes if isinstance(settings.classes, tuple) else network.class_names
    count = ORDERS[settings.classes][0] if isinstance(settings.classes, str) else len(names) if names else None
    found = _reading(answers, given, settings.kind, count)
    if found is None:
        shapes = ", ".join(f"{name!r} {tuple(a.shape)} {a.dtype}" for name, a in answers.items()) or "nothing"
        hint = "" if settings.kind is None else f", not {settings.kind} (kind in {settings.path.name})"
        if any(a.ndim == 3 for a in answers.values()) and not any(a.ndim == 4 for a in answers.values()):
            hint += ": boxes without masks? Export a model that segments"
        raise network.error(f"gives {shapes} for an image of {given[0]}x{given[1]}{hint}")
    return _yolo_segmenter(network, found) if isinstance(found, Yolo) else _dense_segmenter(network, found)


def _reading(
    answers: dict[str, NDArray[Any]], given: tuple[int, int], kind: str | None, count: int | None
) -> Yolo | Dense | None:
    """How to read a network's answers, None where nobody knows. YOLO's prototypes would pass for logits, so they come first; of
    answers that are MaskFormer's none has YOLO's shape."""
    if looks_like_detr(answers):
        return None
    found: Yolo | Dense | None = None
    if kind in (None, "maskformer"):
        found = find_dense(answers, given, "maskformer", count)
    if found is None and kind in (None, "yolo"):
        found = find_yolo(answers, given, count)
    if found is None and kind != "yolo":
        found = find_dense(answers, given, kind, count)
    return found


def _yolo_segmenter(network: PictureNetwork, yolo: Yolo) -> Segmenter:
    targets, order = _targets(network, yolo.count if yolo.count is not None else 80)
    if not network.normalization_given:
        network.mean, network.std = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)

    def label(image: Picture) -> FrameLabels:
        return FrameLabels(*segment_objects(network, yolo, targets, image))

    summary = f"{network.path.name}: objects with masks (YOLO), {_named(targets, order)}"
    return Segmenter(network.path, summary, False, True, label)


def _dense_segmenter(network: PictureNetwork, dense: Dense) -> Segmenter:
    if dense.kind == "labels":
        targets, order = _label_targets(network)
    else:
        found, order = _targets(network, dense.count or 0)
        targets = found.astype(np.int64)
    ids = np.unique(targets[targets != NO_LABEL]).astype(np.uint8)
    if dense.kind == "labels":
        ids = np.unique(np.append(ids, VOID)).astype(np.uint8)
    usual = network.settings.window or WINDOW_PX
    window = (network.size[0] or usual[0], network.size[1] or usual[1])

    def scores(part: Picture) -> Float32:
        padded = network.padded((part.shape[0], part.shape[1]))
        more = [(0, padded[0] - part.shape[0]), (0, padded[1] - part.shape[1]), (0, 0)]
        answers = network.run(np.pad(part, more, mode="symmetric"))
        try:
            found = dense.scores(answers, targets, ids)
        except (KeyError, OutputProblem) as problem:
            raise network.error(str(problem), _classes_help(network.settings)) from problem
        return enlarged(found, padded)[:, : part.shape[0], : part.shape[1]]

    def label(image: Picture) -> FrameLabels:
        own = image.shape[0], image.shape[1]
        size = _shown_size(own, window, network)
        way = cv2.INTER_AREA if size[0] < own[0] else cv2.INTER_LINEAR
        shown = image if size == own else cv2.resize(image, size[::-1], interpolation=way)
        return FrameLabels(ids[best_at_size(blended(shown, window, scores), own)])

    present = ids[ids != VOID]
    summary = f"{network.path.name}: {dense.kind}, {_named(present, order)}, windows of {window[0]}x{window[1]}"
    return Segmenter(network.path, summary, not removable(present).all(), False, label)


def _shown_size(size: tuple[int, int], window: tuple[int, int], network: PictureNetwork) -> tuple[int, int]:
    """The size (height, width) that an image is brought to: it just covers the window, and is not enlarged, unless a short side
    is set, or a fixed window is larger in both directions and it is enlarged to fit into that."""
    scale = min(1.0, max(window[0] / size[0], window[1] / size[1]))
    if network.settings.short_side is not None:
        scale = network.settings.short_side / min(size)
    elif network.fixed and size[0] < window[0] and size[1] < window[1]:
        scale = min(window[0] / size[0], window[1] / size[1])
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _targets(network: PictureNetwork, count: int) -> tuple[NDArray[np.uint8], str]:
    """(C,) trainIds of a network's classes, 255 void, and what names them."""
    settings, names = network.settings, network.class_names
    order: str | None = None
    if isinstance(settings.classes, tuple):
        names, order = settings.classes, f"named in {settings.path.name}"
    elif isinstance(settings.classes, str) or names is None or len(names) != count:
        order = settings.classes if isinstance(settings.classes, str) else BY_COUNT.get(count)
        names = CITYSCAPES if order == "cityscapes" else None
    else:
        order = "named in the file"
    if order is None:
        raise network.error(f"has {count} classes, and no list of such classes is known", _classes_help(settings))
    targets = targets_of(names) if names is not None else order_targets(order)
    if len(targets) != count:
        problem = f"{network.path.name} has {count} classes, and not {len(targets)} ({order})"
        raise SettingsError(problem, path=settings.path, mend="correct classes")
    for name, city in settings.class_map.items():
        if name.isdigit() and int(name) < count:
            number = int(name)
        elif names is not None and name in names:
            number = names.index(name)
        else:
            problem = f"Not a class of {network.path.name}: {name!r} in [map]"
            raise SettingsError(problem, path=settings.path, mend="use its names, or numbers from 0 in quotes")
        targets[number] = train_id(city)
    if not removable(targets).any():
        raise network.error(f"has no class that can be removed among its {count} ({order})", _classes_help(settings))
    return targets, order


def _label_targets(network: PictureNetwork) -> tuple[NDArray[np.int64], str]:
    """(C,) trainId by label of a network that gives labels, and what names them."""
    classes = network.settings.classes
    named = classes if isinstance(classes, tuple) else network.class_names if classes is None else None
    order = classes if isinstance(classes, str) else "cityscapes"
    targets, shown = _targets(network, len(named) if named is not None else ORDERS[order][0])
    return targets.astype(np.int64), shown


def _named(targets: NDArray[np.uint8], order: str) -> str:
    return f"{len(np.unique(targets[targets != VOID]))} Cityscapes classes ({order})"


def _classes_help(settings: NetworkSettings) -> str:
    return (
        f"put classes = [...], its class names in order, or one of {', '.join(ORDERS)} into {settings.path.name} beside it; "
        f'Cityscapes names count, others by [map] "name" = "car"'
    )
