"""Which modules of the add-on write, and where: by ``formats/files.py`` and ``formats/writing/``, which follow no link and leave
what is somebody's; the few that touch the disk in another way, too."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.blender_addon.test_folders import MODULES, imported, name_of

PLACES = {
    "formats/files.py": "one file, whole or not at all",
    "formats/writing/new_files.py": "files of a folder, all together",
    "formats/open_safely.py": "reads; an open file's handle",
    "scene/camera_files.py": "cameras, by Blender's exporters, where they were asked for",
    "scene/images/mask_pictures.py": "renders to places that it is given",
    "scene/images/painted_copies.py": "a copy that is painted on; a folder of its own",
    "scene/shot/movie.py": "renders into the folder of new files",
    "work/command_line.py": "a .blend, where it was asked for",
    "worker/base_python.py": "an environment that the add-on makes",
    "worker/environment.py": "an environment that the add-on makes",
    "worker/jobs.py": "a folder of this session's own",
    "worker/workspace_state.py": "reads; a folder's handle, for its lock",
}
"""Modules that touch the disk by themselves, and where."""
BY_THE_WAYS = {
    "choice/fixes.py": "corrections.json and corrections/ of a workspace",
    "choice/marks.py": "marked.json of a workspace",
    "choice/painted_files.py": "copies that are painted on",
    "formats/sequences.py": "numbered copies in blender/ of a workspace",
    "formats/shot/place.py": "the folder of a shot",
    "formats/shot/writer.py": "the folder of a shot",
    "scene/camera_files.py": "beside cameras that were written",
    "scene/edits/operators_splats.py": "surfels/edited.ply of a workspace",
    "scene/images/painted_copies.py": "copies that are painted on",
    "scene/images/preview.py": "blender/ of a workspace",
    "scene/images/versions_kept.py": "blender/versions/ of a workspace",
    "scene/results.py": "blender/ of a workspace",
    "scene/shot/movie.py": "the folder of a shot",
    "scene/shot/take.py": "the folder of a shot",
    "work/masks/mask_job.py": "outlines/ of a workspace",
    "work/masks/operators_paint_mask.py": "outlines/ of a workspace",
    "work/masks/operators_roto.py": "outlines/ of a workspace",
    "work/operators_outline.py": "outlines/ of a workspace",
    "work/operators_shot.py": "the folder of a shot",
    "work/shot_command.py": "the folder of a shot",
    "worker/receipts.py": "blender/ of a workspace",
}
"""Modules that write by the ways, and where."""
WAYS = {
    *(
        "copied",
        "discard",
        "make_own",
        "move",
        "own_folder",
        "readable_as",
        "set_time_of",
        "write_changed",
        "write_whole",
    ),
    *("NewFiles", "new_files", "shot_folder"),
}
OF_PATHS = {
    *(
        "write_text",
        "write_bytes",
        "mkdir",
        "makedirs",
        "touch",
        "unlink",
        "rmdir",
        "rmtree",
        "symlink_to",
        "hardlink_to",
    ),
    *("chmod", "rename", "copyfile", "copyfileobj", "copytree", "copy2", "mkdtemp", "mkstemp", "TemporaryDirectory"),
    *("NamedTemporaryFile", "tofile", "savez", "save", "save_as", "save_render", "save_as_mainfile", "write_still"),
    *("alembic_export", "usd_export", "export_scene", "collada_export", "obj_export", "ply_export", "stl_export"),
}
"""Names by which files are written, made or removed, of Python and of Blender."""
READING = {
    *(
        "os.path",
        "os.environ",
        "os.name",
        "os.sep",
        "os.pathsep",
        "os.X_OK",
        "os.O_RDONLY",
        "os.O_CLOEXEC",
        "os.access",
    ),
    *("os.stat", "os.lstat", "os.fstat", "os.stat_result", "os.scandir", "os.fsencode", "os.fspath", "os.getpid"),
    *("os.strerror", "os.close", "shutil.which", "shutil.disk_usage", "shutil.ignore_patterns"),
}
"""Of ``os`` and ``shutil``: all else there may change the disk."""


def touched(path: Path) -> Iterator[str]:
    """What a module may change the disk by."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute):
            owner = ast.unparse(node.value)
            listed = owner.endswith((".objects", ".children"))  # of a collection
            system = owner in ("os", "shutil", "tempfile") and f"{owner}.{node.attr}" not in READING
            if (node.attr in OF_PATHS and not listed) or owner == "bpy.ops.render" or system:
                yield f"{owner}.{node.attr}"
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) == "open":
            mode = [a.value for a in (*node.args, *(k.value for k in node.keywords)) if isinstance(a, ast.Constant)]
            if any(isinstance(m, str) and set(m) & set("wax+") and set(m) <= set("rwaxbt+") for m in mode):
                yield ast.unparse(node)


def test_few_modules_touch_the_disk_by_themselves() -> None:
    using = {name_of(path): list(touched(path)) for path in MODULES}
    assert {name: how for name, how in using.items() if how and name not in PLACES} == {}
    assert {name for name in PLACES if not using[name]} == set()


def test_each_place_that_is_written_to_is_known() -> None:
    using = {name_of(p) for p in MODULES if WAYS & {name for _, module, name in imported(p) if "jobs" not in module}}
    assert using - set(PLACES) - set(BY_THE_WAYS) == set() and set(BY_THE_WAYS) <= using


def test_what_writes_is_seen(tmp_path: Path) -> None:
    file = tmp_path / "module.py"
    for text in (
        "open(path, 'w')",
        "path.open(mode='ab')",
        "os.replace(a, b)",
        "patiently(path.unlink)",
        "shutil.move(a, b)",
        "image.save()",
        "bpy.ops.render.render(write_still=True)",
        "bpy.ops.export_scene.fbx(filepath=name)",
    ):
        file.write_text(text)
        assert list(touched(file)), text
    for text in ("open(path)", "os.path.join(a)", "collection.objects.unlink(a)", "text.replace('a', 'b')"):
        file.write_text(text)
        assert not list(touched(file)), text
