"""What opening files, undo and a closed sidebar must not cost, in a real window of Blender.

    python tests/blender_addon/window/opened_files.py --blender blender --extension ZIP -o OUT

A drive that cannot be read is one line of the import dialog, and a good one is imported from it; the sidebar opens by itself. Undo
amid an import, another file amid a run and amid *Check*: all goes on, ends where the artist sees it, and is there when the file is
opened again. An error pops up where the sidebar is closed. Each step leaves a picture; what has to be true is asserted.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from tests.blender_addon.run_in_blender import unveil_python  # noqa: E402
from tests.blender_addon.window.click_path import HELPERS  # noqa: E402
from tests.blender_addon.window.window import BlenderWindow, arguments, made_anew  # noqa: E402
from tests.small_street import make_small_street  # noqa: E402

CALL = """
def call(name, **words):
    window, area, region = region_of("VIEW_3D", "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        return list(getattr(bpy.ops.unveil, name)("INVOKE_DEFAULT", **words))
def named():
    return [bpy.context.scene.unveil.drive, bpy.context.scene.unveil.workspace]
"""
SHOWN_S = 1.0
"""After which Blender has drawn what came from a timer."""


def dialog(window: BlenderWindow, folder: Path, street: Path) -> None:
    """One line where there is no drive; with a drive, *Import* imports it, and the sidebar shows it."""
    bad = made_anew(folder / "bad") / "transforms.json"
    bad.write_text('{"frames": []}')
    assert window.ask(f"call('open_drive', filepath={str(bad)!r})") == ["FINISHED"]
    window.until("not session().busy", 120)
    time.sleep(SHOWN_S)
    window.picture("1_no_drive")
    checked = "module('work.opening.operators_open_drive')._checked"
    assert "transforms.json" in window.ask(f"{checked}.error")
    window.press("Escape")
    assert window.ask("named()") == ["", ""]  # a dialog that is called off leaves the scene as it is
    window.ask(f"call('open_drive', filepath={str(street)!r})")
    window.until("not session().busy", 120)
    time.sleep(SHOWN_S)
    window.picture("2_what_was_found")
    assert window.ask(f"{checked}.error") == "" and not window.ask("area_of('VIEW_3D')[1].spaces.active.show_region_ui")
    window.press("Return")
    window.until("session().busy", 20)
    window.until("not session().busy", 120)
    time.sleep(SHOWN_S)
    assert window.ask("area_of('VIEW_3D')[1].spaces.active.show_region_ui")
    assert window.ask("region_of('VIEW_3D', 'UI')[2].active_panel_category") == "Unveil"
    window.picture("3_imported")


def undone(window: BlenderWindow, folder: Path, street: Path) -> None:
    """Undo amid an import: what it named is named again with its results."""
    # Right after a file was opened no window is in context; the status bar is drawn anew all the same.
    bar = "bar = module('ui.status_bar'); bar._drawn = None; bar._tick()"
    window.tell(f"bpy.ops.wm.read_homefile(app_template=''); {bar}")
    place = folder / "workspace"
    window.ask(f"call('import_drive', filepath={str(street)!r}, workspace={str(place)!r})")
    window.until("session().busy", 20)
    window.move(*(part / 2 for part in window.size))
    window.press("ctrl+z")
    assert window.ask("session().busy")
    window.until("not session().busy", 120)
    time.sleep(SHOWN_S)
    assert window.ask("named()") == [str(street), str(place)] and window.ask("len(objects())") == 1


def another_file(window: BlenderWindow, folder: Path) -> None:
    """Another file amid a run, and amid *Check*; the first one opened again has all that was made meanwhile."""
    blend = folder / "shot.blend"
    window.tell("bpy.context.scene.unveil.quality = 'draft'; bpy.context.scene.unveil.iterations = 60")
    window.tell(f"bpy.ops.unveil.choose(which='VEHICLES'); bpy.ops.wm.save_as_mainfile(filepath={str(blend)!r})")
    window.ask("call('run')")
    window.until("told()[1] == 'reconstruct'", 240)
    worker = window.ask("session().job.pid")
    window.tell("bpy.ops.wm.read_homefile(app_template='')")
    assert window.ask("session().job.pid") == worker
    window.picture("4_another_file")
    window.ask("call('check_python')")
    window.tell("bpy.ops.wm.read_homefile(app_template='')")
    window.until("bpy.ops.unveil.check_python.poll()", 240)
    assert window.ask("module('work.preferences').known(module('work.preferences').preferences(bpy.context)).ok")
    window.until("not session().busy", 600)
    time.sleep(SHOWN_S / 2)
    window.picture("5_ended_there")
    assert window.ask("told()")[0] == "done"
    assert not window.ask("[o.name for o in bpy.data.objects if o.get('unveil_drive')]")
    window.tell(f"bpy.ops.wm.open_mainfile(filepath={str(blend)!r})")
    time.sleep(2 * SHOWN_S)
    window.picture("6_opened_again")
    assert "Mesh after" in window.ask("[o.name for o in bpy.data.objects]")


def error(window: BlenderWindow) -> None:
    """It pops up, though nothing of the add-on is in sight."""
    window.tell("area_of('VIEW_3D')[1].spaces.active.show_region_ui = False")
    window.tell("bpy.context.scene.unveil.drive = '/nowhere'")
    window.ask("call('run')")
    window.until("not session().busy", 60)
    time.sleep(SHOWN_S / 2)
    window.picture("7_error")
    assert window.ask("told()")[0] == "bad input"


def main(words: list[str]) -> None:
    """Everything, in order."""
    given = arguments(__doc__).parse_args(words)
    folder = made_anew(given.output)
    street = make_small_street(folder / "street")
    python = unveil_python(folder, given.python)
    with BlenderWindow(given.blender, folder) as window:
        window.tell(
            f"bpy.ops.extensions.package_install_files(filepath={str(given.extension.absolute())!r}, "
            "repo='user_default', enable_on_install=True)"
        )
        window.tell(HELPERS + CALL)
        window.tell(f"module('work.preferences').preferences(bpy.context).python = {str(python)!r}")
        window.tell("bpy.data.batch_remove(bpy.data.objects)")
        dialog(window, folder, street)
        undone(window, folder, street)
        another_file(window, folder)
        error(window)
    print(f"passed; look at the pictures in {folder}")


if __name__ == "__main__":
    main(sys.argv[1:])
