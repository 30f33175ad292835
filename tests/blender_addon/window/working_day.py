"""What must not get into an artist's way during a working day, in a real window of Blender.

    python tests/blender_addon/window/working_day.py --blender blender --extension ZIP -o OUT

Under a studio's colour configuration, which has no view called Standard: a drive is dropped onto the window; while a job runs,
Blender saves by itself, plays, renders, and Esc cancels nothing; old work is not cancelled without a question; results are one
undo step; a drive that is linked from a library stays as it is. What was measured is in ``OUT/working_day.json``.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from tests.blender_addon.run_in_blender import unveil_python  # noqa: E402
from tests.blender_addon.window.click_path import LONGEST_CALLBACK_MS, group_of, open_sidebar  # noqa: E402
from tests.blender_addon.window.no_lost_work import ended, ready  # noqa: E402
from tests.blender_addon.window.window import BlenderWindow, arguments, crowded, made_anew  # noqa: E402

CONFIGURATION = """ocio_profile_version: 2
strictparsing: false
luma: [0.2126, 0.7152, 0.0722]
roles:
  scene_linear: Plate linear
  default: Plate linear
  default_float: Plate linear
  default_byte: Plate display
  default_sequencer: Plate display
  color_picking: Plate display
  data: Numbers
file_rules:
  - !<Rule> {name: Default, colorspace: default}
displays:
  Monitor:
    - !<View> {name: Show look, colorspace: Plate display}
    - !<View> {name: Log look, colorspace: Plate linear}
active_displays: [Monitor]
active_views: [Show look, Log look]
colorspaces:
  - !<ColorSpace> {name: Plate linear, encoding: scene-linear, isdata: false}
  - !<ColorSpace> {name: Numbers, encoding: data, isdata: true}
  - !<ColorSpace>
    name: Plate display
    encoding: sdr-video
    isdata: false
    to_scene_reference: !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055}
"""
"""Without a view Standard and without Non-Color: names are a studio's own."""
LONG_S = 66
"""Longer than the least interval of Blender's autosave, and than work that is cancelled without a question."""
VIEW = """window, area, region = region_of('VIEW_3D', 'WINDOW')
with bpy.context.temp_override(window=window, area=area, region=region):
    """


def dropped(window: BlenderWindow, drive: Path, workspace: Path) -> None:
    """Onto the 3D view, as Blender takes a dropped file; the dialog asks, and Return imports."""
    look = "[bpy.context.scene.view_settings.view_transform, bpy.context.scene.display_settings.display_device]"
    before = window.ask(look)
    assert before == ["Show look", "Monitor"], f"Blender does not use the studio's configuration: {before}"
    window.tell("bpy.data.batch_remove(bpy.data.objects)")
    window.tell("bpy.ops.mesh.primitive_cube_add(location=(0, 0, 50)); bpy.context.object.name = 'Prop'")
    left, top, right, bottom = window.ask("rectangle('VIEW_3D', 'WINDOW')")
    window.move((left + right) / 3, (top + bottom) / 2)
    window.tell(
        VIEW
        + f"bpy.ops.wm.drop_import_file('INVOKE_DEFAULT', directory={str(drive.parent)!r}, files=[{{'name': {drive.name!r}}}])"
    )
    window.until("session().busy", 20)  # it is looked at first
    window.until("not session().busy", 120)
    time.sleep(1)
    window.picture("01_dropped")
    window.press("Return")
    window.until("session().busy", 20)
    ended(window, "done")
    time.sleep(1)
    window.picture("02_imported")
    assert window.ask(look) == before
    assert window.ask("[bpy.context.scene.frame_start, bpy.context.scene.frame_current]") == [1001, 1001]
    assert Path(window.ask("bpy.context.scene.unveil.workspace")) == workspace
    assert window.ask("'Prop' in bpy.data.objects")


def usable(window: BlenderWindow, saves: Path) -> dict[str, object]:
    """A job of more than a minute, with all that an artist does meanwhile."""
    window.tell("bpy.context.scene.unveil.quality = 'standard'")
    window.tell("bpy.ops.unveil.choose(which='VEHICLES'); bpy.ops.ed.undo_push(message='chosen')")
    window.tell(VIEW + "bpy.ops.unveil.run('INVOKE_DEFAULT')")
    window.until("session().busy")
    started, pid = time.monotonic(), window.ask("session().job.pid")
    window.until("told()[1] == 'reconstruct' and told()[2] > 5", 120)
    assert window.ask("[o.bl_idname for w in bpy.context.window_manager.windows for o in w.modal_operators]") == []
    left, top, right, bottom = window.ask("rectangle('VIEW_3D', 'WINDOW')")
    window.move((left + right) / 3, (top + bottom) / 2)

    window.press("space")  # playback
    time.sleep(2)
    assert window.ask("bpy.context.screen.is_animation_playing or window_is_playing()", PLAYING)
    first = window.ask("bpy.context.scene.frame_current")
    time.sleep(1.5)
    played = window.ask("bpy.context.scene.frame_current")
    window.press("Escape")  # ends playback, and nothing else
    time.sleep(1)
    assert played != first, "playback stands while a job runs"
    assert not window.ask("window_is_playing()", PLAYING)
    assert window.ask("session().busy and not session().job.cancelling"), "Esc cancelled the work"

    window.tell("bpy.context.scene.render.engine = 'BLENDER_WORKBENCH'")
    window.tell("bpy.context.scene.render.resolution_percentage = 25")
    window.press("F12")
    window.until("area_of('IMAGE_EDITOR') is not None and not bpy.app.is_job_running('RENDER')", 60)
    time.sleep(1)
    window.picture("03_rendered_meanwhile")
    window.press("Escape")
    time.sleep(1)
    assert window.ask("session().busy and not session().job.cancelling"), "Esc in a render's window cancelled the work"

    answers = []
    while time.monotonic() - started < LONG_S or not list(saves.glob("*.blend")):
        asked = time.monotonic()
        window.ask("1")
        answers.append(time.monotonic() - asked)
        time.sleep(0.2)
        assert time.monotonic() - started < 200, "Blender has not saved by itself within 200 s"
        assert window.ask("session().busy"), window.ask("told()")
    saved = time.monotonic() - started

    x, y = window.find(r"unveil.cancel\(")
    window.click(x, y)
    time.sleep(1)
    window.picture("04_cancel_asks")
    assert window.ask("not session().job.cancelling"), "old work was cancelled without a question"
    window.press("Escape")
    time.sleep(1)
    assert window.ask("session().busy and not session().job.cancelling")
    window.click(*window.find(r"unveil.cancel\("))
    time.sleep(1)
    pressed = time.monotonic()
    window.press("Return")
    while group_of(pid):
        assert time.monotonic() - pressed < 10, "Cancel did not end the work"
        time.sleep(0.01)
    took = time.monotonic() - pressed
    ended(window, "cancelled")
    count, total, longest = window.ask("ticks()")
    assert 1000 * longest < LONGEST_CALLBACK_MS * crowded(), f"the longest callback took {1000 * longest:.1f} ms"
    answers.sort()
    return {
        "autosave_after_s": round(saved, 1),
        "cancel_to_end_of_group_s": round(took, 2),
        "callbacks": count,
        "callback_mean_ms": round(1000 * total / count, 3),
        "callback_longest_ms": round(1000 * longest, 3),
        "answer_of_the_interface_ms_median": round(1000 * answers[len(answers) // 2], 1),
    }


PLAYING = "def window_is_playing():\n    return any(w.screen.is_animation_playing for w in bpy.context.window_manager.windows)\n"


def undone(window: BlenderWindow, drive: Path) -> None:
    """Results are one undo step, after whatever the artist did meanwhile; early ones come before the report."""
    window.tell("bpy.ops.wm.read_homefile(use_factory_startup=True)")
    window.tell("bpy.data.objects['Cube'].name = 'Prop'")
    window.tell(f"bpy.ops.unveil.import_drive(filepath={str(drive)!r})")
    window.tell("bpy.context.scene.unveil.quality = 'draft'; bpy.ops.unveil.choose(which='VEHICLES')")
    window.tell("bpy.ops.ed.undo_push(message='draft')")
    open_sidebar(window)
    window.tell(VIEW + "bpy.ops.unveil.run('INVOKE_DEFAULT')")
    window.until("session().busy")
    window.until("'Mesh after' in bpy.data.objects", 300)
    early = window.ask("session().busy")
    ended(window, "done")
    assert early, "meshes were seen only at the end"
    time.sleep(1)
    window.picture("05_results")
    there = "sorted(o.name for o in bpy.data.objects)"
    whole = window.ask(there)
    assert "Mesh after" in whole and "Prop" in whole
    left, top, right, bottom = window.ask("rectangle('VIEW_3D', 'WINDOW')")
    window.move((left + right) / 3, (top + bottom) / 2)
    for _ in range(4):
        window.press("ctrl+z")
        time.sleep(0.5)
        if "Mesh after" not in window.ask(there):
            break
    less = window.ask(there)
    assert "Mesh after" not in less and "Prop" in less, less
    for _ in range(4):
        window.press("ctrl+shift+z")
    time.sleep(0.5)
    assert window.ask(there) == whole


def linked(window: BlenderWindow, library: Path, workspace: Path) -> None:
    """A drive of a library, beside which the same workspace is loaded."""
    window.tell(f"bpy.ops.wm.save_as_mainfile(filepath={str(library)!r})")
    window.tell("bpy.ops.wm.read_homefile(use_factory_startup=True)")
    window.tell(
        f"with bpy.data.libraries.load({str(library)!r}, link=True) as (there, here):\n"
        "    here.collections = ['street']\n"
        "bpy.context.scene.collection.children.link(here.collections[0])"
    )
    window.tell(f"bpy.ops.unveil.load_workspace(directory={str(workspace)!r})")
    time.sleep(1)
    window.picture("06_beside_a_library")
    own = "[bool(o.library) for o in bpy.data.objects if o.get('unveil_role') == 'points']"
    assert sorted(window.ask(own)) == [False, True], window.ask(own)


def main() -> int:
    """All of it."""
    parser = arguments(__doc__)
    given = parser.parse_args()
    out, extension = made_anew(given.output), given.extension.absolute()
    (out / "saves").mkdir()
    python = unveil_python(out, given.python)
    program = "import sys, pathlib; from tests.small_street import make_small_street as m; m(pathlib.Path(sys.argv[1]))"
    subprocess.run([python, "-c", program, str(out / "street")], check=True)
    shutil.copytree(ROOT / "sample_scenes/parked_street", out / "parked_street")
    (out / "studio.ocio").write_text(CONFIGURATION)
    environ = {"BLENDER_USER_RESOURCES": str(out / "user"), "OCIO": str(out / "studio.ocio")}
    with BlenderWindow(given.blender, out, environ=environ) as window:
        version = window.ask("bpy.app.version_string")
        paths = "bpy.context.preferences.filepaths"
        window.tell(
            f"{paths}.temporary_directory = {str(out / 'saves')!r}; {paths}.use_auto_save_temporary_files = True"
        )
        window.tell(f"{paths}.auto_save_time = 1")
        ready(window, extension, python)
        dropped(window, out / "parked_street/transforms.json", out / "parked_street_unveiled")
        measured = usable(window, out / "saves")
        undone(window, out / "street/transforms.json")
        linked(window, out / "library.blend", out / "street_unveiled")
    told = {
        "blender": version,
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "configuration": "without a view Standard",
        **measured,
    }
    (out / "working_day.json").write_text(json.dumps(told, indent=2) + "\n")
    print(json.dumps(told, indent=2))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
