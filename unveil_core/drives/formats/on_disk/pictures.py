"""Files that a drive names and that lie there otherwise: suffixes in capitals or left out, paths of another machine."""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PureWindowsPath

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.checks.numbers_in_names import natural_key

__all__ = ["PICTURES", "NamedFiles", "files_below", "pictures_below", "pictures_in"]

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".exr", ".dpx")
"""Suffixes of pictures that are read, the likelier first."""
USUAL_FOLDERS = ("images",)
"""Where pictures lie whose own folder is not there."""
MOST_FILES = 200_000
"""That are looked through: a folder with more is none of pictures."""


class NamedFiles:
    """Finds the files that a drive's file names.

    A folder that is there is believed: what it lacks was deleted. One that is not there is that of another machine; then the
    folder of the same name beside the drive's file is taken, or of the last of its names.

    Args:
        source: the file that names them, for messages; root: the folder that names are relative to, the file's own by default.

    Attributes:
        moved: pictures that were found in another folder than the named one: their names and places.
        changed: pictures that were found with another suffix, likewise.
    """

    def __init__(self, source: Path, root: Path | None = None) -> None:
        self.source, self.root = source, source.parent if root is None else root
        self.moved: dict[str, Path] = {}
        self.changed: dict[str, Path] = {}
        self._listed: dict[Path, dict[str, str]] = {}
        self._places: dict[str, list[Path]] = {}

    def pictures(self, names: Sequence[object], key: str) -> list[Path | None]:
        """The pictures that are meant, None for those that are not there. One that is named as it lies is that of no other name.

        Args:
            key: that names them, for messages.
        Raises:
            DriveError: no system has files of such a name.
        """
        texts = [str(name) for name in names]
        paths = [named_path(self.root, text, self.source, key) for text in texts]
        there = [bool(path.suffix) and _is_there(path) for path in paths]
        taken = {path: text for path, text, exact in zip(paths, texts, there, strict=True) if exact}
        return [
            path if exact else self._otherwise(text, path, taken)
            for path, text, exact in zip(paths, texts, there, strict=True)
        ]

    def _otherwise(self, text: str, path: Path, taken: dict[Path, str]) -> Path | None:
        """A picture that does not lie as it is named."""
        found = self._find(text, path, PICTURES, other_suffix=True)
        if found is None or taken.setdefault(found, text) != text:
            return None
        if found.parent != path.parent:
            self.moved[text] = found
        if path.suffix.lower() in PICTURES and found.suffix.lower() != path.suffix.lower():
            self.changed[text] = found
        return found

    def file(self, name: object, key: str) -> Path:
        """Any other file; as it is named where it is not there.

        Raises:
            DriveError: no system has files of such a name.
        """
        text = str(name)
        path = named_path(self.root, text, self.source, key)
        if _is_there(path):
            return path
        return self._find(text, path, (), other_suffix=False) or path

    def notices(self) -> list[str]:
        """What a user should know of what was found."""
        lines = []
        if self.moved:
            name, place = next(iter(self.moved.items()))
            where = self._shown(place.parent)
            lines.append(
                f"{len(self.moved)} pictures are named as of another place, the first {name}: those in {where} are taken"
            )
        if self.changed:
            name, place = next(iter(self.changed.items()))
            lines.append(
                f"{len(self.changed)} pictures have another suffix than their names: {place.name} is taken for {name}"
            )
        return lines

    def missing_because(self, name: str) -> str:
        """What lies where a picture is missing, for the mend of an error."""
        folder = named_path(self.root, name, self.source, "file_path").parent
        for place in (folder, *(self.root / n for n in USUAL_FOLDERS), self.root):
            held = pictures_in(place) if place.is_dir() and place.is_relative_to(self.root) else []
            if held:
                some = f"{len(held)} pictures of other names, as" if len(held) > 1 else "one picture,"
                return f"{self._shown(place)} holds {some} {held[0]}: name these, or restore the photographs"
        return "no pictures lie beside it: restore them, or correct file_path"

    def _shown(self, folder: Path) -> str:
        inner = os.path.relpath(folder, self.root).replace(os.sep, "/")
        return f"{self.root.name if inner == '.' else inner}/"

    def _find(self, text: str, path: Path, suffixes: Sequence[str], *, other_suffix: bool) -> Path | None:
        folder = str(path.parent)
        if folder not in self._places:
            known = path.parent != self.root and path.parent.is_dir()
            self._places[folder] = [path.parent] if known else self._tails(text)
        for place in self._places[folder]:
            found = self._alike(place, path.name, suffixes, other_suffix)
            if found is not None:
                self._places[folder] = [place]  # of one folder all lie in one
                return found
        return None

    def _tails(self, text: str) -> list[Path]:
        """Folders below the drive's that end as the named one does, the longest first, then the usual ones."""
        windows = PureWindowsPath(text.removeprefix("file://"))
        parts = [p for p in windows.parts[:-1] if p not in (windows.anchor, ".", "..")]
        tails = [parts[k:] for k in range(len(parts) + 1)] + [[n] for n in USUAL_FOLDERS]
        with suppress(OSError, ValueError):
            return [place for tail in tails if (place := self._folder(tail)) is not None]
        return []

    def _folder(self, parts: Sequence[str]) -> Path | None:
        """A folder below the drive's by the names that lead to it, in capitals or small letters; None where it is not there."""
        place = self.root
        for part in parts:
            if not (place / part).is_dir():
                alike = [p for p in place.iterdir() if p.name.lower() == part.lower() and p.is_dir()]
                if not alike:
                    return None
                part = alike[0].name
            place = place / part
        return place

    def _alike(self, folder: Path, name: str, suffixes: Sequence[str], other_suffix: bool) -> Path | None:
        listed = self._names_in(folder)
        exact = listed.get(name.lower())
        stem, suffix = os.path.splitext(name.lower())
        if exact is not None and (suffix or not suffixes):
            return folder / exact
        if suffix not in suffixes:
            stem, other_suffix = name.lower(), True  # it was left out
        found = [listed[stem + s] for s in suffixes if stem + s in listed] if other_suffix else []
        if suffix in suffixes and len(found) != 1:
            found = []  # of two with other suffixes nothing tells which
        name_there = found[0] if found else exact
        return None if name_there is None else folder / name_there

    def _names_in(self, folder: Path) -> dict[str, str]:
        """Names of the files in a folder by what they are in small letters."""
        if folder not in self._listed:
            self._listed[folder] = {n.lower(): n for n in sorted(_files_in(folder), reverse=True)}
        return self._listed[folder]


def pictures_in(folder: Path) -> list[str]:
    """Names of the pictures in a folder, numbers as numbers."""
    return sorted((n for n in _files_in(folder) if _is_picture(n)), key=natural_key)


def pictures_below(folder: Path) -> list[str]:
    """The same with those in its folders, as ``camera/0000.png``; none where there are too many to be looked through."""
    return [n for n in files_below(folder) if _is_picture(n.rpartition("/")[2])]


def files_below(folder: Path) -> list[str]:
    """The files in a folder and its folders, likewise; hidden ones are left out."""
    found: list[str] = []
    held = 0
    for place, _, files in os.walk(folder):
        held += len(files)
        if held > MOST_FILES:
            return []
        inner = os.path.relpath(place, folder).replace(os.sep, "/")
        found += [n if inner == "." else f"{inner}/{n}" for n in files if not n.startswith(".")]
    return sorted(found, key=natural_key)


def _is_picture(name: str) -> bool:
    return name.lower().endswith(PICTURES) and not name.startswith(".")


def _is_there(path: Path) -> bool:
    with suppress(OSError, ValueError):
        return not stat.S_ISDIR(path.stat().st_mode)
    return False


def _files_in(folder: Path) -> list[str]:
    """Names of what is in a folder and no folder itself; links that lead nowhere are not there."""
    found = []
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if not entry.is_dir() and (not entry.is_symlink() or os.path.exists(entry.path)):
                found.append(entry.name)
    return found
