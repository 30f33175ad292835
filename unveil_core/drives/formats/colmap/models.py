"""Which model of a folder is read: COLMAP's mapper begins a new one wherever pictures do not hang together, and the first may be
the smallest. The largest is taken; ``--model`` decides, and joins those that share pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.formats.colmap.model import Lens, ModelImage, read_cameras, read_images, read_model_points
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import nearest_rotation

__all__ = ["Model", "chosen_model", "find_model", "has_model", "model_folders", "model_of_pictures"]

EVERY = "all"
"""``--model`` that joins all models that share pictures with the largest."""
LEAST_SHARED = 2
"""Pictures that tell how two models lie to each other; one tells no scale."""
AGREE = 0.2
"""Shared pictures of models that are joined lie at the same places up to a share of their extent."""
SHOWN = 8
"""Models that a line lists at most."""


@dataclass(frozen=True, eq=False)
class Model:
    """Attributes:
    names: of its folders, more than one where models were joined. folders: that it was read from.
    images: in the order of the files, each with its lens and where it comes from; points.
    """

    names: tuple[str, ...]
    folders: tuple[Path, ...]
    images: tuple[tuple[ModelImage, Lens | None, Path], ...]
    points: PointCloud


def model_folders(path: Path) -> list[Path]:
    """The folders of models at or under a path, the likelier first: itself, those in ``sparse/``, in ``colmap/sparse/``."""
    if _is_model(path):
        return [path]
    for place in (path / "sparse", path / "colmap/sparse", path):
        inner = _models_in(place, numbered=place == path)
        inner += [place] if place != path and _is_model(place) else []
        if inner:
            return inner
    return []


def _models_in(place: Path, *, numbered: bool) -> list[Path]:
    """Models in the folders of a place, by the numbers in their names; of any folder only those that are called by a number."""
    try:
        folders = [p for p in place.iterdir() if (p.name.isdigit() or not numbered) and p.is_dir() and _is_model(p)]
    except OSError:
        return []
    return sorted(folders, key=lambda p: natural_key(p.name))


def _is_model(folder: Path) -> bool:
    return any((folder / f"images{suffix}").is_file() for suffix in (".bin", ".txt"))


def find_model(path: Path) -> Path | None:
    """The folder of a COLMAP model at or under a path, the first in the usual places."""
    return next(iter(model_folders(path)), None)


def has_model(path: Path) -> bool:
    """Whether a folder is, or holds in one of the usual places, a model with cameras, not only files of such a name."""
    folder = find_model(path)
    return folder is not None and any((folder / f"cameras{suffix}").is_file() for suffix in (".bin", ".txt"))


def chosen_model(
    path: Path, folders: Sequence[Path], wanted: str | None, how_many: Callable[[Sequence[str]], int]
) -> tuple[Model, list[str]]:
    """The model that is read, and what a user should know of the choice.

    Args:
        path: of the drive, for messages; folders: of its models; wanted: the name of one, of several with commas, "all", or None.
        how_many: of the pictures of these names are there.
    Raises:
        SettingsError: there is no such model, or it shares too few pictures with those that it is to be joined with.
        DriveError: a model that is damaged.
    """
    if len(folders) == 1 and wanted is None:
        return _read(folders[0], read_images(folders[0]), alone=True), []
    images, notices = _images_of(folders, wanted)
    by_name = {f.name: f for f in folders}
    sizes = ", ".join(f"{n} ({len(images[n])} pictures)" for n in list(images)[:SHOWN]) + ", …" * (len(images) > SHOWN)
    there = {n: how_many([i.name for i in own]) for n, own in images.items()}
    order = sorted(images, key=lambda n: (-there[n], -len(images[n])))  # stable: of equal ones the first
    names = [order[0]] if wanted is None else order if wanted == EVERY else [n.strip() for n in wanted.split(",")]
    unknown = [n for n in names if n not in images]
    if unknown:
        raise SettingsError(f"{path} has no model {unknown[0]}", mend=f"it has {sizes}")
    if wanted is None:
        order, more = _readable(order, by_name, images)
        names, notices = order[:1], [*notices, *more]
    read, left = _read(by_name[names[0]], images[names[0]]), list(dict.fromkeys(names[1:]))
    while left:
        placed = {n: p for n in left if (p := _placed(read.images, images[n])) is not None}
        if not placed:
            break
        name = next(iter(placed))
        read = _joined(read, _read(by_name[name], images[name]), placed[name][0])
        notices.append(f"model {name} is joined with model {names[0]} by {placed[name][1]} pictures that both have")
        left.remove(name)
    if left and wanted != EVERY:
        raise SettingsError(
            f"model {left[0]} of {path} shares fewer than {LEAST_SHARED} pictures with model {','.join(read.names)}, or has them "
            "elsewhere",
            mend="their place to each other is unknown: give --model one of them",
        )
    if wanted is None and len(images) > 1:
        notices.append(_told(order, images, sizes))
    elif left:
        notices.append(f"models that share too few pictures with the others are left out: {', '.join(left)}")
    return read, notices


def _readable(
    order: list[str], folders: dict[str, Path], images: dict[str, list[ModelImage]]
) -> tuple[list[str], list[str]]:
    """The models in their order from the first one that is whole, and what is wrong with those before.

    Raises:
        DriveError: none is; of the first.
    """
    wrong: dict[str, DriveError] = {}
    for k, name in enumerate(order):
        try:
            _read(folders[name], images[name])
            return order[k:], [f"model {n} is left out: {error}" for n, error in wrong.items()]
        except DriveError as error:
            wrong[name] = error
    raise next(iter(wrong.values()))


def _images_of(folders: Sequence[Path], wanted: str | None) -> tuple[dict[str, list[ModelImage]], list[str]]:
    """The images of each model by name. One that is damaged is left out, unless there is no other or it is asked for."""
    found: dict[str, list[ModelImage]] = {}
    damaged: dict[str, DriveError] = {}
    for folder in folders:
        try:
            found[folder.name] = read_images(folder)
        except DriveError as error:
            damaged[folder.name] = error
    asked = [n for n in damaged if wanted is not None and n in map(str.strip, wanted.split(","))]
    if asked or not found:
        raise damaged[asked[0]] if asked else next(iter(damaged.values()))
    return found, [f"model {name} is left out: {error}" for name, error in damaged.items()]


def model_of_pictures(folders: Sequence[Path], names: Sequence[str]) -> Path | None:
    """The model that most of some pictures were taken from, and of those that are alike the one with fewest others.

    Args:
        names: of the pictures' files, without their folders.
    """
    if len(folders) < 2:
        return next(iter(folders), None)
    images, _ = _images_of(folders, None)
    wanted = set(names)

    def fits(folder: Path) -> tuple[int, int]:
        own = [i.name.replace("\\", "/").rpartition("/")[2] in wanted for i in images.get(folder.name, ())]
        return sum(own), -len(own)

    return max(folders, key=fits)


def _told(order: Sequence[str], images: dict[str, list[ModelImage]], sizes: str) -> str:
    taken, path = order[0], Path()
    sharing = [n for n in order[1:] if _placed([(i, None, path) for i in images[taken]], images[n]) is not None]
    lacks = {i.name for n in order[1:] for i in images[n]} - {i.name for i in images[taken]}
    line = f"found {len(order)} models, {sizes}: {taken} is taken"
    line += f", without {len(lacks)} pictures that only others have" if lacks else ""
    line += "; --model N decides"
    if sharing and lacks:
        line += f"; --model {','.join([taken, *sharing])} joins those that share pictures"
    return line


def _read(folder: Path, images: Sequence[ModelImage], *, alone: bool = False) -> Model:
    """A model; one that is ``alone`` may have no file of points, for they can be found in the photographs."""
    lenses = read_cameras(folder)
    bare = alone and not any((folder / f"points3D{suffix}").is_file() for suffix in (".bin", ".txt"))
    points = PointCloud(np.zeros((0, 3))) if bare else read_model_points(folder)
    return Model((folder.name,), (folder,), tuple((i, lenses.get(i.camera), folder) for i in images), points)


def _placed(
    base: Sequence[tuple[ModelImage, Lens | None, Path]], other: Sequence[ModelImage]
) -> tuple[Similarity, int] | None:
    """The similarity from another model's coordinates to those of a first one, by the pictures that both have, and how many these
    are; None where they are too few or do not agree."""
    known = {i.name: i.world_to_camera for i, *_ in base}
    pairs = [(known[i.name], i.world_to_camera) for i in other if i.name in known]
    if len(pairs) < LEAST_SHARED:
        return None
    to, of = (np.stack([p[k] for p in pairs]) for k in (0, 1))
    with np.errstate(all="ignore"):
        rotation, _ = nearest_rotation(np.einsum("nji,njk->ik", to[:, :3, :3], of[:, :3, :3]))
        centre_to, centre_of = (-np.einsum("nji,nj->ni", m[:, :3, :3], m[:, :3, 3]) for m in (to, of))
        there, here = centre_to - centre_to.mean(axis=0), (centre_of - centre_of.mean(axis=0)) @ rotation.T
        square, extent = float((here**2).sum()), float(np.sqrt((there**2).sum()))
        scale = float((there * here).sum()) / square if square > 0 else 0.0
        off = float(np.sqrt(((there - scale * here) ** 2).sum()))
    if not (0 < scale < np.inf and extent > 0 and off <= AGREE * extent):
        return None
    shift = centre_to.mean(axis=0) - scale * rotation @ centre_of.mean(axis=0)
    return Similarity(scale, rotation, shift), len(pairs)


def _joined(base: Model, other: Model, to_base: Similarity) -> Model:
    """Both models in the coordinates of the first; of a picture that both have, the first one's pose counts."""
    known = {i.name for i, *_ in base.images}
    rotation, scale, shift = to_base.rotation, to_base.scale, to_base.translation
    added = []
    for image, lens, folder in other.images:
        if image.name not in known:
            pose = image.world_to_camera.copy()
            with np.errstate(all="ignore"):
                pose[:3, :3] = pose[:3, :3] @ rotation.T
                pose[:3, 3] = scale * image.world_to_camera[:3, 3] - pose[:3, :3] @ shift
            added.append((ModelImage(image.name, image.camera, pose), lens, folder))
    a, b = base.points, other.points
    colors = None if a.colors is None or b.colors is None else np.concatenate([a.colors, b.colors])
    points = PointCloud(np.concatenate([a.positions, to_base.to_world(b.positions)]), colors, a.measured and b.measured)
    return Model((*base.names, *other.names), (*base.folders, *other.folders), (*base.images, *added), points)
