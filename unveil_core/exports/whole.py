"""An exported folder appears whole, or not at all: it is made under a temporary name beside its place and renamed. Only what an
export made, and nobody changed since, is replaced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import parsed_json, write_json_atomic
from unveil_core.base.output.scratch import exchanged, scratch_folder
from unveil_core.base.output.stamps import is_as_it_was, stamp_of
from unveil_core.base.output.written import EXPORTED, GENERATOR, check_replaceable, files_in, stamps_in, written_in

__all__ = ["TOLD", "camera_file", "check_free", "tell", "whole_folder"]

TOLD = EXPORTED
"""The file in each exported folder that tells what it is, and lists the files that were written with it."""


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder to fill; renamed to ``path`` at the end, in the place of an older export; removed on an error.

    Raises:
        SettingsError: see :func:`check_free`.
    """
    check_free(path)
    with scratch_folder(path.parent, "export") as folder:
        made = folder / "made"
        made.mkdir()
        yield made
        told: Any = parsed_json((made / TOLD).read_bytes()) if (made / TOLD).is_file() else {"generator": GENERATOR}
        names = list(files_in(made))
        like = made / names[0] if names else None  # who may not read the files may not read of them
        # By size and time alone: to read it all again would take as long as to copy it.
        files = {name: stamp_of(made / name, content=False) for name in names if name != TOLD}
        write_json_atomic(made / TOLD, {**told, "files": files}, like=like)
        check_free(path)  # meanwhile somebody may have put something there
        exchanged(made, path)


def tell(folder: Path, name: str, content: Mapping[str, Any]) -> None:
    """Write :data:`TOLD` into a folder of format ``name``, with what a program cannot see in its files."""
    write_json_atomic(folder / TOLD, {"format": name, "generator": GENERATOR, **content})


def camera_file(name: str) -> str:
    """The name of a camera as that of its folder in an export: not that of :data:`TOLD`."""
    return f"camera_{name}" if name.casefold() == TOLD else name


def check_free(path: Path) -> None:
    """Refuse a folder with anything in it that no export wrote, or that was changed since.

    Raises:
        SettingsError: with what is there and the mend.
    """
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise SettingsError("Not a folder, and so not replaced", path=path, mend="name another place with -o")
    mend = "move it, or name another place with -o"
    check_replaceable(path, written_in(path, TOLD), mend=mend)
    changed = (n for n, stamp in (stamps_in(path, TOLD) or {}).items() if not is_as_it_was(path / n, stamp))
    if (name := next(changed, None)) is not None:
        raise SettingsError("Changed since Unveil wrote it, and so not replaced", path=path / name, mend=mend)
