# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's preferences: which Python has unveil, what it is, and a button that makes one."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from .. import __package__ as ADDON  # not this folder: Blender knows the add-on by the package above
from ..worker import environment
from ..worker.base_python import lost_base
from ..worker.interpreter import Candidate, Found, candidates, check, find, venv_python
from .installing import page

__all__ = [
    "OFFLINE",
    "UnveilPreferences",
    "environment_folder",
    "known",
    "known_interpreter",
    "may_install",
    "preferences",
    "remember",
    "search",
    "unveil_interpreter",
    "work_folder",
]

PYTORCH_CPU = "https://download.pytorch.org/whl/cpu" if sys.platform.startswith("linux") else ""
"""On Linux the usual index has builds with CUDA, of gigabytes; elsewhere the usual ones are for the processor."""

OFFLINE = "turn on Preferences > System > Network > Online Access, or name a Folder of Wheels"

_known: dict[str, Found] = {}
"""By what the preferences name: the interpreter that was found for it."""


def _whole_path(name: str) -> Any:
    """Blender's file browser writes paths from the open file, as ``//../tools``: they are made whole at once, for the next file may
    be a stranger's."""

    def made_whole(self: UnveilPreferences, context: bpy.types.Context) -> None:
        named = str(getattr(self, name))
        if named.startswith("//") and bpy.data.filepath:
            setattr(self, name, os.path.abspath(bpy.path.abspath(named)))

    return made_whole


class UnveilPreferences(bpy.types.AddonPreferences):
    """Kept with Blender's preferences."""

    bl_idname = ADDON

    python: StringProperty(
        name="Python",
        subtype="FILE_PATH",
        update=_whole_path("python"),
        description="The Python that has unveil, or the folder of its virtual environment; empty: looked for in the usual places",
    )
    install_from: StringProperty(
        name="Install From",
        description="What Install installs: a wheel, a source folder or an address; empty: the unveil that came with "
        "the add-on",
    )
    wheels: StringProperty(
        name="Folder of Wheels",
        subtype="DIR_PATH",
        update=_whole_path("wheels"),
        description="Install takes all from this folder, without a network: make wheels fills one; "
        "empty: from the package index",
    )
    torch_index: StringProperty(
        name="Index for Torch",
        default=PYTORCH_CPU,
        description="Package index that torch comes from; empty: the usual one, whose torch for Linux has CUDA. "
        "Without meaning where a Folder of Wheels is named",
    )
    segmenter: StringProperty(
        name="Segmenter",
        subtype="FILE_PATH",
        update=_whole_path("segmenter"),
        description="The usual network that labels frames: the import dialog proposes it; FILE.toml beside it tells how",
    )

    def draw(self, context: bpy.types.Context) -> None:
        looking = not bpy.ops.unveil.check_python.poll()
        page.draw(self.layout, self, known(self), looking=looking, may_install=may_install(self))


def may_install(chosen: Any) -> bool:
    """Whether an environment can be made as things stand: from a folder of wheels, or online."""
    return bool(bpy.app.online_access or (chosen and chosen.wheels.strip()))


def preferences(context: bpy.types.Context) -> Any:
    """The add-on's preferences, whatever its package is called; None where it is not enabled as an add-on."""
    entry = context.preferences.addons.get(ADDON)
    return entry.preferences if entry else None


def environment_folder(*, create: bool = False) -> Path | None:
    """Where the add-on makes its environment; None where it is not installed as an extension."""
    try:
        return Path(bpy.utils.extension_path_user(ADDON, path="", create=create)) / "environment"
    except ValueError:
        return None


def work_folder(context: bpy.types.Context) -> Path:
    """Where the scene's results lie or will lie; the user's folder before there is a drive."""
    settings = context.scene.unveil
    place = bpy.path.abspath(settings.workspace or settings.drive)
    return Path(place).absolute() if place else Path.home()


def _candidates(context: bpy.types.Context) -> list[Candidate]:
    chosen = preferences(context)
    folder = environment_folder()
    return candidates(
        chosen.python if chosen else "",
        own=venv_python(folder) if folder is not None and environment.is_ready(folder) else None,
    )


def known(chosen: Any) -> Found | None:
    """What was found for the present preferences, without looking."""
    return _known.get(chosen.python if chosen else "")


def remember(context: bpy.types.Context, found: Found) -> None:
    """What a thorough check has found for the present preferences."""
    chosen = preferences(context)
    _known[chosen.python if chosen else ""] = found


def forget() -> None:
    """Look anew next time."""
    _known.clear()


def unveil_interpreter(context: bpy.types.Context, *, full: bool = False) -> Found | None:
    """The Python that has unveil; looked for once, then remembered as long as it is there.

    Args:
        full: check it thoroughly, which takes seconds.
    Returns:
        what was found, also if it does not do (``ok`` and ``problem`` tell); None where there is nothing to look at.
    """
    found = known_interpreter(context) or find(_candidates(context))
    if full and found is not None and found.ok:
        found = check(Candidate(found.python, found.source), work=work_folder(context))
    if found is not None:
        remember(context, found)
    return found


def known_interpreter(context: bpy.types.Context) -> Found | None:
    """The Python that has unveil, where it was found before and is still there; None where it has to be looked for."""
    found = known(preferences(context))
    is_there = found is not None and found.ok and found.python.exists()
    return found if is_there and not lost_base(found.python.parent.parent) else None


def search(context: bpy.types.Context) -> Callable[[], Found | None]:
    """What looks for it as :func:`unveil_interpreter` does, and may be called in any thread: it asks Blender for nothing."""
    chosen = preferences(context)
    key, places = chosen.python if chosen else "", _candidates(context)

    def look() -> Found | None:
        found = find(places)
        if found is not None:
            _known[key] = found
        return found

    return look


CLASSES = (UnveilPreferences,)


def unregister() -> None:
    forget()
