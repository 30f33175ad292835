"""What lies outside a workspace and counts for its stages: the drive, marked objects, networks, the true empty street."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.networks.onnx_files import files_of
from unveil_core.corrections.files import read_corrections
from unveil_core.drives import Drive, open_drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.truth_files import truth_files
from unveil_core.drives.marked import files_named, read_marked
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

__all__ = [
    "check_networks",
    "check_segmenter",
    "files_of_corrections",
    "files_of_drive",
    "files_of_marked",
    "files_of_moving_marks",
    "files_of_networks",
    "files_of_truth",
    "let_go",
    "opened",
    "opened_once",
]

_held: ContextVar[dict[tuple[Path, DriveOptions], Drive] | None] = ContextVar("held", default=None)


@contextmanager
def opened_once() -> Iterator[None]:
    """A block in which :func:`opened` reads a drive once, up to :func:`let_go`: what a run looks at before its first stage, whose
    files it goes by and what it imports is one drive. The tables of some datasets take seconds to read."""
    before = _held.set({})
    try:
        yield
    finally:
        _held.reset(before)


def let_go() -> None:
    """Hold no drive any longer: stages after the import read what was imported, and a long drive's points are large."""
    _held.set(None)


def opened(drive: str | Path, options: DriveOptions) -> Drive:
    """See :func:`unveil_core.drives.open_drive` and :func:`opened_once`."""
    held, key = _held.get(), (Path(drive).absolute(), options)
    if held is None:
        return open_drive(drive, options)
    if key not in held:
        held[key] = open_drive(drive, options)
    return held[key]


def files_of_drive(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """Everything that a drive consists of. Where it lies counts too: the workspace refers to its ground truth."""
    found = opened(drive, settings.drive_options)
    files = [*found.sources, *(s.path for s in found.sweeps)]
    for f in found.frames:
        files += [p for p in (f.semantic_path, f.instance_path, f.mask_path) if p is not None]
        files += [f.image_path] if f.image_bytes is None else []
    if "segmenter" in settings.networks:
        from unveil_core.labelling.segmenter import segmenter_files

        files += segmenter_files(settings.networks["segmenter"])
    return [(str(path.absolute()), path) for path in dict.fromkeys(files)]  # a table holds many sweeps


def check_segmenter(settings: RunSettings) -> None:
    """Raise a SettingsError unless the named network is there and labels images."""
    if "segmenter" in settings.networks:
        from unveil_core.labelling.segmenter import load_segmenter

        load_segmenter(settings.networks["segmenter"])


def files_of_marked(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """See ``Stage.outside``; nothing where the settings name no file."""
    if settings.marked is None:
        return []
    path = Path(settings.marked)
    pictures = [p for m in read_marked(path) if m.mattes is not None for p in files_named(m.mattes)]
    return [(p.name, p) for p in (path, *pictures)]


def files_of_moving_marks(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """See ``Stage.outside``; the mattes of marked objects that move: another mark does not make the scene anew."""
    marks = () if settings.marked is None else read_marked(Path(settings.marked))
    return [(f"{m.id}/{p.name}", p) for m in marks if m.moves and m.mattes is not None for p in files_named(m.mattes)]


def files_of_corrections(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """See ``Stage.outside``; nothing where the settings name no file."""
    if settings.corrections is None:
        return []
    path = Path(settings.corrections)
    return [(p.name, p) for p in (path, *(file for c in read_corrections(path) for file in c.files))]


def files_of_networks(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """The networks that the settings name, with the weights that lie beside them."""
    found = []
    for name, path in settings.networks.items():
        found += [(name + file.name.removeprefix(path.name), file) for file in files_of(path)]
    return found


def check_networks(settings: RunSettings) -> None:
    """Raise a SettingsError unless the named networks are there and are such networks."""
    inpainter(settings.inpainter)
    if "reference_inpainter" in settings.networks:
        load_reference(settings.networks["reference_inpainter"])


def files_of_truth(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """The true empty street, where the drive has one."""
    imported = read_imported(workspace.drive_dir, points=False)
    truth = imported.truth_root
    if truth is None or not truth.is_dir():
        return []
    return [(p.relative_to(truth).as_posix(), p) for p in truth_files(truth, imported)]
