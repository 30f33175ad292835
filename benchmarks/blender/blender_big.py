"""A big drive in Blender: seconds to load its workspace, size of the .blend, milliseconds to draw panels and boxes.

    python benchmarks/blender/blender_big.py [--before COMMIT] [--rounds N] [--frames N] [--points N] [--triangles N]
                                            [--keep FOLDER]

The workspace is that of ``big_workspace.py``. Each version of the add-on is measured in a process of its own, with bpy and user
folders of its own; an earlier one comes out of git. Drawing is that of Python alone: layouts are stand-ins, and there is no
window. Results go to benchmarks/results/blender_big.json.
"""

from __future__ import annotations

import argparse
import importlib
import io
import json
import os
import resource
import statistics
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import MethodType, SimpleNamespace
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks/results/blender_big.json"
PACKAGE = "bl_ext.user_default.unveil"
PARTS = {
    "scene.drive_scene": ("read_drive", "_cameras", "_points"),
    "choice.selection": ("fill",),
    "scene.results": ("_plates", "_strips", "_keyframes", "_mesh", "load_mesh", "_splats"),
}
"""Functions whose seconds are told, by the module that they are called from."""
ROUNDS = 30
"""Of drawing."""
CLASS_ROWS, OBJECT_ROWS = 3, 6
"""That the lists show."""


# ------------------------------------------------------------------------------------------------------------- in a child


def add_on(folder: Path) -> Callable[[str], Any]:
    """Enable the add-on in that folder; returns what gets its modules by their names."""
    extensions = Path(os.environ["BLENDER_USER_RESOURCES"]) / "extensions/user_default"
    extensions.mkdir(parents=True)
    (extensions / "unveil").symlink_to(folder, target_is_directory=True)
    import bpy

    bpy.context.preferences.use_preferences_save = False
    assert importlib.import_module("addon_utils").enable(PACKAGE, default_set=True) is not None
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return lambda name: importlib.import_module(f"{PACKAGE}.{name}")


def timed_parts(module: Callable[[str], Any]) -> dict[str, float]:
    """Seconds of each part, which grow from now on."""
    seconds: dict[str, float] = {}

    def watched(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **kwargs: Any) -> Any:
            begun = time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - begun

        return timed

    for owner, names in PARTS.items():
        for name in names:
            if hasattr(module(owner), name):
                setattr(
                    module(owner), name, watched(name.strip("_").removeprefix("load_"), getattr(module(owner), name))
                )
    return seconds


class StandIn:
    """Stands for a UILayout."""

    def __getattr__(self, name: str) -> Callable[..., StandIn]:
        return lambda *args, **kwargs: StandIn()


def milliseconds(call: Callable[[], object]) -> dict[str, float]:
    """Median and most of some rounds, after one that does not count."""
    call()
    taken = []
    for _ in range(ROUNDS):
        begun = time.perf_counter()
        call()
        taken.append((time.perf_counter() - begun) * 1e3)
    return {"median_ms": round(statistics.median(taken), 2), "most_ms": round(max(taken), 2)}


def drawing(module: Callable[[str], Any]) -> dict[str, dict[str, float]]:
    """What a redraw of the sidebar and of the boxes takes, and a move of the pointer."""
    import bpy

    versions, scene = module("scene.versions"), bpy.context.scene
    versions.has_window = lambda: True  # states of stages are read by a thread, as in a window
    found = {}
    for name in ("panel_run.UNVEIL_PT_work", "panel_run.UNVEIL_PT_run", "panel_drive.UNVEIL_PT_drive"):
        found[name.split(".")[1]] = milliseconds(lambda name=name: draw(module, name))
    lists = module("ui.panel_selection")

    def what_goes() -> None:
        draw(module, "panel_selection.UNVEIL_PT_selection")
        listed = scene.unveil_selection
        kind = SimpleNamespace(bitflag_filter_item=1 << 30)
        lists.UNVEIL_UL_classes.filter_items(kind, bpy.context, listed, "classes")
        for owner, items, rows in (
            (lists.UNVEIL_UL_classes, listed.classes, CLASS_ROWS),
            (lists.UNVEIL_UL_objects, listed.objects, OBJECT_ROWS),
        ):
            for item in items[:rows]:
                owner.draw_item(kind, bpy.context, StandIn(), listed, item, 0, listed, "active")
                _ = item.chosen  # a check box asks for it

    found["UNVEIL_PT_selection"] = milliseconds(what_goes)
    found["UNVEIL_PT_results"] = milliseconds(lambda: draw(module, "panel_results.UNVEIL_PT_results"))
    gizmos, camera = module("choice.box_gizmos"), scene.camera
    width, height = 1600, 900
    matrix = camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=width, y=height)
    region = SimpleNamespace(width=width, height=height)
    region_data = SimpleNamespace(perspective_matrix=matrix @ camera.matrix_world.inverted())
    seen = SimpleNamespace(scene=scene, region=region, region_data=region_data)
    found["boxes drawn"] = milliseconds(lambda: gizmos.lines_of(bpy.context, 1))
    found["boxes pointed at"] = milliseconds(lambda: gizmos.box_at(seen, (width / 2, height * 0.45)))
    parts = [row for name, row in found.items() if name != "boxes pointed at"]
    found["all drawn"] = {key: round(sum(row[key] for row in parts), 2) for key in ("median_ms", "most_ms")}
    return found


def draw(module: Callable[[str], Any], name: str) -> None:
    """Call a panel's draw() with a layout that is none."""
    import bpy

    file, panel = name.split(".")
    owner = getattr(module(f"ui.{file}"), panel)
    stand_in = SimpleNamespace(layout=StandIn())
    for part, value in vars(owner).items():
        if part.startswith("_") and not part.startswith("__") and callable(value):
            setattr(stand_in, part, MethodType(value, stand_in))
    owner.draw(stand_in, bpy.context)


def megabytes(path: Path) -> float:
    return round(path.stat().st_size / 1e6, 1)


def sizes(folder: Path) -> dict[str, Any]:
    """The .blend, and each mesh in one of its own."""
    import bpy

    found: dict[str, Any] = {}
    for name, compress in (("blend_mb", False), ("blend_compressed_mb", True)):
        begun = time.perf_counter()
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"), compress=compress, copy=True)
        found[name] = megabytes(folder / f"{name}.blend")
        found[name.replace("_mb", "_saved_s")] = round(time.perf_counter() - begun, 2)
    found["meshes_mb"] = {}
    for mesh in bpy.data.meshes:
        bpy.data.libraries.write(str(folder / "one.blend"), {mesh}, compress=False)
        found["meshes_mb"][mesh.name] = megabytes(folder / "one.blend")
    found["largest_block_mb"] = max(found["meshes_mb"].values())
    found["images"] = {kind: sum(i.source == kind for i in bpy.data.images) for kind in ("SEQUENCE", "FILE")}
    found["images_packed"] = sum(i.packed_file is not None for i in bpy.data.images)
    return found


def full_detail() -> dict[str, Any]:
    """All triangles of one mesh, and back."""
    import bpy

    seconds = []
    for _ in range(2):
        begun = time.perf_counter()
        bpy.ops.unveil.full_detail()
        seconds.append(round(time.perf_counter() - begun, 2))
        if len(seconds) == 1:
            triangles = max(len(m.polygons) for m in bpy.data.meshes if m.name.startswith("Mesh"))
    return {"triangles": triangles, "load_s": seconds[0], "back_s": seconds[1]}


def measure(add_on_folder: Path, workspace: Path) -> dict[str, Any]:
    """All of one version, in this process."""
    module = add_on(add_on_folder)
    import bpy

    scene, load = bpy.context.scene, module("work.loading").load
    scene.unveil.workspace = str(workspace)
    seconds, found = timed_parts(module), {}
    for name in ("load", "load_again"):
        seconds.clear()
        begun, used = time.perf_counter(), time.process_time()
        load(bpy.context, workspace)
        found[f"{name}_s"] = round(time.perf_counter() - begun, 2)
        found[f"{name}_processor_s"] = round(time.process_time() - used, 2)
        found[f"{name}_parts_s"] = {part: round(value, 3) for part, value in seconds.items()}
    found["peak_memory_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    found["triangles"] = {m.name: len(m.polygons) for m in bpy.data.meshes if m.name.startswith("Mesh")}
    found["drawing"] = drawing(module)
    found |= sizes(workspace.parent)
    if hasattr(module("scene.view"), "FULL_DETAIL"):
        found["full_detail"] = full_detail()
    return {"blender": bpy.app.version_string, **found}


# --------------------------------------------------------------------------------------------------------------- all of it


def earlier(commit: str, folder: Path) -> Path:
    """The add-on of a commit, unpacked into a folder."""
    packed = subprocess.run(["git", "archive", commit, "blender_addon"], cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
        archive.extractall(folder, filter="data")
    return folder / "blender_addon"


def in_a_child(add_on_folder: Path, workspace: Path) -> dict[str, Any]:
    """The figures of a version; what it made in the workspace goes before, so that each begins alike."""
    subprocess.run(["rm", "-rf", str(workspace / "blender")], check=True)
    with tempfile.TemporaryDirectory() as name:
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("BLENDER_", "PYTHON"))}
        environment = {**kept, "BLENDER_USER_RESOURCES": f"{name}/user", "PYTHONDONTWRITEBYTECODE": "1"}
        out = Path(name) / "figures.json"
        command = [sys.executable, __file__, "--measure", str(add_on_folder), str(workspace), str(out)]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
        return json.loads(out.read_text())


def typical(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The run that took the middle of all times to load, with what the others took."""
    ordered = sorted(runs, key=lambda run: run["load_s"])
    return {**ordered[len(ordered) // 2], "load_s_of_all_runs": [run["load_s"] for run in ordered]}


def main() -> None:
    """Measure the add-on as it is and, where asked for, as it was."""
    if sys.argv[1:2] == ["--measure"]:
        folder, workspace, out = (Path(a) for a in sys.argv[2:5])
        out.write_text(json.dumps(measure(folder, workspace)))
        sys.stdout.flush()
        os._exit(0)  # bpy can crash at exit
    sys.path.insert(0, str(ROOT))
    from benchmarks.blender.big_workspace import BigWorkspace, make_big_workspace
    from unveil_core.bench.timing import machine

    parser = argparse.ArgumentParser()
    parser.add_argument("--before", metavar="COMMIT")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="the workspace, made where it is not there")
    for name in ("frames", "points", "triangles"):
        parser.add_argument(f"--{name}", type=int, default=getattr(BigWorkspace, name))
    parser.add_argument("--rounds", type=int, default=3, help="runs of each version, in turn")
    given = parser.parse_args()
    big = BigWorkspace(given.frames, given.points, given.triangles)
    with tempfile.TemporaryDirectory() as name:
        workspace = given.keep or Path(name) / "workspace"
        if not workspace.exists():
            make_big_workspace(workspace, big)
        versions = {given.before: earlier(given.before, Path(name) / "before")} if given.before else {}
        runs: dict[str, list[dict[str, Any]]] = {}
        for _ in range(given.rounds):
            for version, folder in {**versions, "now": ROOT / "blender_addon"}.items():
                row = "now" if version == "now" else f"before ({version})"
                runs.setdefault(row, []).append(in_a_child(folder, workspace))
                print(row, json.dumps(runs[row][-1], indent=1), flush=True)
        rows = {row: typical(found) for row, found in runs.items()}
    if big == BigWorkspace() and given.before:
        drive = {"frames": 2 * big.frames, "size": big.size, "points": big.points, "triangles_of_a_mesh": big.triangles}
        drive |= {"surfels_of_a_state": big.surfels, "objects": big.objects}
        RESULTS.write_text(json.dumps({"machine": machine(), "drive": drive, "versions": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
