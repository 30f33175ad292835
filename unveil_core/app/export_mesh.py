"""``unveil export``: a finished mesh in the format and size that another program wants."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import SettingsError, UnveilError, WorkspaceError
from unveil_core.drives.imported import read_imported
from unveil_core.mesh import decimate, read_ply, write_glb, write_obj, write_ply
from unveil_core.workspace.workspace import Workspace

__all__ = ["FORMATS", "STATES", "export_mesh"]

FORMATS = ("ply", "obj", "glb")
STATES = ("empty", "full")


def export_mesh(
    workspace: Workspace,
    *,
    to: str | None = None,
    state: str = "empty",
    triangles: int | None = None,
    output: Path | None = None,
) -> Path:
    """Write one of the workspace's meshes to a file of its own, in the drive's coordinates.

    PLY and OBJ hold world coordinates in full; a GLB holds local ones under a node that is moved to the world (see
    :mod:`unveil_core.mesh.export`).

    Args:
        workspace: whose ``unveil mesh`` has run.
        to: one of :data:`FORMATS`; by default that of the suffix of ``output``.
        state: one of :data:`STATES`.
        triangles: the most that the file may have; None for all.
        output: where to; ``meshes/<state>_<triangles or all>.<to>`` by default.
    Returns:
        the file written.
    Raises:
        WorkspaceError: no mesh there yet, or nothing in it.
        SettingsError: an unknown format or state, too few triangles, or a file that the workspace needs itself.
    """
    suffix = output.suffix.lower().removeprefix(".") if output is not None else to
    kind = to or suffix
    known = ", ".join(FORMATS)
    if kind is None:
        raise SettingsError("no format is named", mend=f"give one with --to: {known}")
    if kind not in FORMATS or suffix != kind:
        raise SettingsError(f"is no {to or 'mesh'} file", path=output, mend=f"name it .{to}" if to else f"use {known}")
    if state not in STATES:
        raise SettingsError(f"no state is called {state!r}", mend=f"use {', '.join(STATES)}")
    folder = workspace.root / "meshes"
    source = folder / f"{state}.ply"
    path = output if output is not None else folder / f"{state}_{triangles or 'all'}.{kind}"
    if path.resolve() in {(folder / name).resolve() for name in ("full.ply", "empty.ply", "empty.glb")}:
        raise SettingsError("is the workspace's own mesh", path=path, mend="name another file")
    if path.is_dir():
        raise SettingsError("is a folder", path=path, mend="name a file in it")
    drive = read_imported(workspace.drive_dir, points=False)
    mesh = read_ply(source, drive.to_world)
    if not len(mesh.faces):
        raise WorkspaceError("has no triangles", path=source, mend="run `unveil mesh` on a scene that has surfaces")
    if triangles is not None:
        try:
            mesh = decimate(mesh, triangles)
        except SettingsError as error:
            raise SettingsError(error.problem, path=source, mend=error.mend) from error
    try:
        if kind == "ply":
            write_ply(mesh, path, drive.to_world)
        elif kind == "obj":
            write_obj(mesh, path, drive.to_world)
        else:
            write_glb(mesh, path, drive.to_world)
    except OSError as error:
        raise UnveilError(f"cannot be written: {error.strerror}", path=path) from error
    return path
