"""A run on an existing workspace goes on with the settings that it was made with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.options.given import changed_from_default
from unveil_core.pipeline.other_drive import place_of
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

__all__ = ["Kept", "kept_settings"]

RESET = "--reset takes the defaults"


@dataclass(frozen=True)
class Kept:
    """Settings of a workspace that a run goes on with.

    Attributes:
        settings: those that it was made with, or the defaults; message: which of them are kept, in a line, or empty.
    """

    settings: RunSettings
    message: str = ""


def kept_settings(
    workspace: str | Path, drive: str | Path, given: Iterable[str] = (), *, reset: bool = False, replace: bool = False
) -> Kept:
    """What a workspace was made with; the defaults where there is none yet, or another drive is to replace it.

    Args:
        given: names of settings that are told anew.
        reset: whether the defaults are wanted.
        replace: whether results of another drive may be replaced.
    Raises:
        SettingsError: it records settings that this version does not have.
        WorkspaceError: the folder holds something else, or a damaged workspace.
    """
    if reset or not Workspace(Path(workspace)).workspace_json.is_file():
        return Kept(RunSettings())
    state = Workspace(Path(workspace)).state()
    recorded, made_of = state.get("settings"), str(state.get("drive", ""))
    if not recorded or (replace and made_of and place_of(Path(made_of)) != place_of(Path(drive))):
        return Kept(RunSettings())
    try:
        settings = RunSettings.from_json(recorded)
    except SettingsError as error:
        raise SettingsError(error.problem, path=workspace, mend=f"{error.mend}; {RESET}") from error
    told = [f"{name} {word}" for name, word in changed_from_default(settings).items() if name not in set(given)]
    if not told:
        return Kept(settings)
    return Kept(settings, f"Keeping the settings that the workspace was made with: {', '.join(told)} ({RESET})")
