"""Each state of the add-on at the sizes at which it is tight: a window of 1280x800, and everything drawn at 200 %.

    python tests/blender_addon/window/states.py --blender blender --extension ZIP --workspace WORKSPACE -o OUT

Look at the pictures, ``small_*.png`` and ``double_*.png``: no label may be cut off, and nothing lie over another thing.
"""

from __future__ import annotations

import shutil
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from tests.blender_addon.run_in_blender import unveil_python  # noqa: E402
from tests.blender_addon.window.click_path import HELPERS, OPEN_SECTIONS  # noqa: E402
from tests.blender_addon.window.window import BlenderWindow, arguments, made_anew  # noqa: E402

SIZES = {"small": ((1280, 800), 1.0), "double": ((1920, 1200), 2.0)}
"""Of the screen, pixels, and of what Blender draws."""
PAGES = 8
"""Pictures of the sidebar with all sections open, each farther down."""


def start(window: BlenderWindow, extension: Path, python: Path, scale: float) -> None:
    """Install, with everything drawn that large, and the sidebar's tab open."""
    window.tell(f"bpy.context.preferences.view.ui_scale = {scale}; bpy.context.preferences.view.show_splash = False")
    window.tell(
        f"bpy.ops.extensions.package_install_files(filepath={str(extension)!r}, repo='user_default', enable_on_install=True)"
    )
    window.tell(HELPERS)
    window.tell(OPEN_SECTIONS)
    window.tell("bpy.ops.screen.userpref_show(section='ADDONS'); bpy.context.window_manager.addon_search = 'Unveil'")
    time.sleep(2)
    window.press_button(r"addon_expand\(", across=0.03, area="PREFERENCES", region="WINDOW")


def show_tab(window: BlenderWindow) -> None:
    """Its tab can be chosen once it was drawn."""
    window.tell("area_of('VIEW_3D')[1].spaces.active.show_region_ui = True")
    time.sleep(1)
    window.tell("region_of('VIEW_3D', 'UI')[2].active_panel_category = 'Unveil'")
    time.sleep(1)


def pictures(window: BlenderWindow, kind: str, extension: Path, python: Path, workspace: Path, drive: Path) -> None:
    """All states, one after the other."""

    def picture(name: str) -> None:
        time.sleep(1.5)
        window.picture(f"{kind}_{name}")

    start(window, extension, python, SIZES[kind][1])
    picture("01_preferences")
    window.tell(f"module('work.preferences').preferences(bpy.context).python = {str(python)!r}")
    window.tell("with bpy.context.temp_override(window=area_of('PREFERENCES')[0]): bpy.ops.wm.window_close()")
    show_tab(window)
    picture("02_nothing_imported")
    window.tell(
        "window, area, region = region_of('VIEW_3D', 'WINDOW')\n"
        "with bpy.context.temp_override(window=window, area=area, region=region):\n"
        f"    bpy.ops.unveil.check_drive('INVOKE_DEFAULT', filepath={str(drive)!r})"
    )
    window.until("session().busy")
    window.until("not session().busy", 180)
    picture("03_import_dialog")
    window.press("Escape")
    window.tell(f"bpy.ops.unveil.load_workspace(directory={str(workspace)!r})")
    window.tell("bpy.context.scene.unveil.show_more = True")
    left, top, _, bottom = window.ask("rectangle('VIEW_3D', 'UI')")
    for page in range(PAGES):
        picture(f"04_sections_{page}")
        window.scroll(left + 10 * SIZES[kind][1], (top + bottom) / 2, 9)  # beside the list, which would scroll itself
    window.tell("bpy.context.scene.unveil.show_more = False")
    window.scroll(left + 10 * SIZES[kind][1], (top + bottom) / 2, -9 * PAGES)
    window.tell(
        "window, area, region = region_of('VIEW_3D', 'WINDOW')\n"
        "with bpy.context.temp_override(window=window, area=area, region=region):\n"
        "    bpy.ops.unveil.stage('INVOKE_DEFAULT', stage='mesh')"
    )
    window.until("told()[2] > 0 or not session().busy", 180)
    picture("06_running")
    window.until("not session().busy", 400)
    picture("07_done")
    shutil.move(workspace / "drive/cameras.json", workspace / "cameras.gone")
    window.tell(
        "try:\n    bpy.ops.unveil.stage('INVOKE_DEFAULT', stage='mesh')\nexcept RuntimeError as error:\n    print(error)"
    )
    window.until("not session().busy", 180)
    picture("08_error")
    shutil.move(workspace / "cameras.gone", workspace / "drive/cameras.json")
    window.tell("bpy.ops.unveil.paint_frame()")
    window.until("area_of('IMAGE_EDITOR') is not None", 20)
    picture("09_painting")


def main() -> int:
    """All of it."""
    parser = arguments(__doc__)
    parser.add_argument("--workspace", type=Path, required=True, help="of a finished run")
    parser.add_argument("--drive", type=Path, default=ROOT / "sample_scenes/parked_street/transforms.json")
    given = parser.parse_args()
    out = made_anew(given.output)
    python = unveil_python(out, given.python)
    for kind, (size, _) in SIZES.items():
        workspace = Path(shutil.copytree(given.workspace, out / f"{kind}_ws"))
        environ = {"BLENDER_USER_RESOURCES": str(out / f"{kind}_user")}
        with BlenderWindow(given.blender, out, size=size, environ=environ, log=f"{kind}.log") as window:
            pictures(window, kind, given.extension.absolute(), python, workspace, given.drive.absolute())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
