"""Masks that lie beside the pictures, where no file names them: COLMAP's ``masks/``, Instant-NGP's ``dynamic_mask_*.png``."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from unveil_core.base.checks.numbers_in_names import counting_numbers
from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.drives.drive import Frame
from unveil_core.drives.formats.cameras import picture_size
from unveil_core.drives.formats.on_disk.pictures import PICTURES, files_below, pictures_below, pictures_in
from unveil_core.drives.labels.codes import BLACK, WHITE, LabelCodes, MaskCode

__all__ = ["with_masks_beside"]

FOLDERS = ("masks", "mask")
"""That hold masks, the likelier first."""
OF_ARRAYS = ("images_masks", "input_masks")
"""Folders of StreetUnveiler's masks, which are arrays."""
NGP = "dynamic_mask_"
"""What comes before the stem of a picture in the name of Instant-NGP's mask of it, in small letters."""
AFFIX = re.compile(
    r"^(?:dynamic_)?masks?[_.\- ]+|[_.\- ]+(?:dynamic_)?masks?$|^(?:dynamic_)?mask(?=[0-9])", re.IGNORECASE
)
"""What names of masks have that names of their pictures have not."""


@dataclass(frozen=True)
class _Found:
    """Attributes:
    of: masks by index of their frame. where: the folder, as a notice names it. count: pictures in it.
    usual: whether all of them are named as COLMAP names masks. first_other: a picture that is no mask.
    by_number: whether they were found by the numbers in their names.
    """

    of: dict[int, Path]
    where: str
    count: int
    usual: bool
    first_other: str | None = None
    by_number: bool = False


def with_masks_beside(
    frames: Sequence[Frame], root: Path, pictures: Path, decides: str, *, usual: bool
) -> tuple[list[Frame], list[str]]:
    """Frames without masks with those that lie beside them, and what a user should know of it.

    Args:
        root: folder in which ``masks/`` may lie; pictures: folder that the photographs' names are relative to.
        decides: what a user may say instead.
        usual: whether ``masks/NAME.png`` is a rule of the format, so that nothing needs to be told of it.
    """
    for found, white in ((_of_ngp(frames), True), (_among_photographs(frames), False)):
        misfit = None if found is None else _misfit(found, frames)
        if misfit is not None:
            return list(frames), [misfit]
        if found is not None:
            what = "white = remove, as Instant-NGP has it" if white else "black = remove"
            codes = LabelCodes(mask=MaskCode(WHITE if white else BLACK))
            masked = [replace(f, mask_path=found.of.get(i), codes=codes) for i, f in enumerate(frames)]
            return masked, [f"{found.count} masks {found.where} are taken: {what}; {decides} decides"]
    found = next((f for n in FOLDERS if (f := _in_folder(frames, root / n, pictures)) is not None), None)
    if found is None:
        return list(frames), _no_pictures(root)
    notices = []
    if not found.of:
        notices.append(
            f"{found.where} holds {found.count} pictures, none of them named like a photograph: they are not read "
            f"({found.where}NAME.png is the mask of NAME)"
        )
    else:
        by_rule = usual and found.usual
        misfit = None if by_rule else _misfit(found, frames)
        if misfit is not None:
            return list(frames), [misfit]
        rest = found.count - len(found.of)
        if rest:
            notices.append(
                f"{found.where}: {rest} of {found.count} masks belong to no photograph, the first {found.first_other}"
            )
        if not by_rule:
            by = "by the number in its name" if found.by_number else "by name"
            told = (
                f"{len(found.of)} of {len(frames)} photographs have a mask in {found.where}, found {by}: black = remove"
            )
            notices.append(f"{told}; {decides} decides")
    return [replace(f, mask_path=found.of.get(i)) for i, f in enumerate(frames)], notices


def _misfit(found: _Found, frames: Sequence[Frame]) -> str | None:
    """Why masks that nobody named cannot be those of their photographs, None where they can."""
    for i, path in found.of.items():
        camera = frames[i].camera
        try:
            size = picture_size(path)
            if path == next(iter(found.of.values())):
                read_label_image(path)
        except DriveError as error:
            return f"masks {found.where} are not read: {error}"
        if size != (camera.width, camera.height):
            wanted = f"its photograph {camera.width}x{camera.height}"
            return f"masks {found.where} are not read: {path.name} is {size[0]}x{size[1]} pixels, {wanted}"
    return None


def _no_pictures(root: Path) -> list[str]:
    """That folders of masks hold files of another kind, as arrays."""
    lines = []
    for name in (*FOLDERS, *OF_ARRAYS):
        held = files_below(root / name)
        if held:
            lines.append(
                f"{name}/ holds {len(held)} files that are not read as masks, the first {held[0]}: masks are pictures"
            )
    return lines


def _of_ngp(frames: Sequence[Frame]) -> _Found | None:
    """Masks beside the pictures themselves, as Instant-NGP looks for them."""
    found: dict[int, Path] = {}
    held: dict[Path, dict[str, str]] = {}
    for i, frame in enumerate(frames):
        folder = frame.image_path.parent
        if folder not in held:
            own = [n for n in pictures_in(folder) if n.lower().startswith(NGP)]
            held[folder] = {os.path.splitext(n)[0].lower().removeprefix(NGP): n for n in own}
        for name in (frame.image_path.stem, frame.image_path.name) if held[folder] else ():
            if (mask := held[folder].get(name.lower())) is not None:
                found.setdefault(i, folder / mask)
    count = sum(map(len, held.values()))
    return _Found(found, "beside the photographs (dynamic_mask_*)", count, False) if found else None


def _among_photographs(frames: Sequence[Frame]) -> _Found | None:
    """Masks beside the pictures under their names and a word, as ``0000_mask.png``."""
    photographs = {f.image_path for f in frames}
    found: dict[int, Path] = {}
    held: dict[Path, dict[str, str]] = {}
    for i, frame in enumerate(frames):
        folder = frame.image_path.parent
        if folder not in held:
            own = [n for n in pictures_in(folder) if "mask" in n.lower() and folder / n not in photographs]
            held[folder] = {AFFIX.sub("", os.path.splitext(n)[0].lower()): n for n in own}
        mask = held[folder].get(frame.image_path.stem.lower())
        if mask is not None:
            found[i] = folder / mask
    if not found:
        return None
    return _Found(found, f"beside the photographs, as {next(iter(found.values())).name},", len(found), False)


def _in_folder(frames: Sequence[Frame], folder: Path, pictures: Path) -> _Found | None:
    """Masks in a folder of their own, None where it holds no pictures or is not there."""
    names = pictures_below(folder)
    if not names:
        return None
    exact = {n: folder / n for n in names}
    loose: dict[str, str] = {}
    for name in names:
        for key in _keys(name):
            loose[key] = "" if loose.get(key, name) != name else name
    found: dict[int, Path] = {}
    all_usual = True
    for i, frame in enumerate(frames):
        name = _relative(frame.image_path, pictures)
        stem = name.rpartition(".")[0] if name.lower().endswith(PICTURES) else name
        usual = exact.get(f"{name}.png") or exact.get(f"{stem}.png")
        keys = (name, stem, name.rpartition("/")[2], stem.rpartition("/")[2])
        other = next((m for k in keys if (m := loose.get(k.lower()))), None)
        if usual is not None or other is not None:
            found[i] = usual if usual is not None else folder / str(other)
            all_usual &= usual is not None
    by_number = not found
    if by_number:
        found, all_usual = _by_number(frames, folder, names), False
    if len(set(found.values())) < len(found):
        found = {}  # one mask for two photographs is a guess too many
    used = set(found.values())
    first_other = next((n for n in names if folder / n not in used), None)
    return _Found(found, f"{folder.name}/", len(names), all_usual, first_other, by_number)


def _by_number(frames: Sequence[Frame], folder: Path, names: Sequence[str]) -> dict[int, Path]:
    """Of one camera's photographs and as many masks, both of which count by a number: the same numbers belong together."""
    if len({f.camera_name for f in frames}) > 1:
        return {}
    of_frames = counting_numbers([f.image_path.stem for f in frames])
    of_masks = counting_numbers([n.rpartition(".")[0] for n in names])
    if of_frames is None or of_masks is None or len(set(of_masks)) < len(names):
        return {}
    by_number = dict(zip(of_masks, names, strict=True))
    return {i: folder / by_number[n] for i, n in enumerate(of_frames) if n in by_number}


def _keys(name: str) -> list[str]:
    """What a picture may be called whose mask has this name, in small letters: ``a/0000.jpg.png`` is that of ``a/0000.jpg`` and of
    ``a/0000``, ``0000_mask.png`` that of ``0000``."""
    folder, slash, last = name.lower().rpartition("/")
    stem = last.rpartition(".")[0]
    bare = stem.rpartition(".")[0] if stem.endswith(PICTURES) else stem
    keys = dict.fromkeys((stem, bare, AFFIX.sub("", bare)))
    return [k for key in keys if key for k in dict.fromkeys((f"{folder}{slash}{key}", key))]


def _relative(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name
