"""The pictures of the pages, of a finished workspace in Blender's window: choosing, a job, a wipe, painting, results.

    python tests/blender_addon/window/pictures.py --blender blender --extension ZIP --workspace WORKSPACE -o OUT [--frame 9]
        [--into blender_addon/pictures]

Made for readers, not for tests: nothing is asserted. They are made anew by make test-window, so that none shows what is no more.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from tests.blender_addon.run_in_blender import unveil_python  # noqa: E402
from tests.blender_addon.window.no_lost_work import ready  # noqa: E402
from tests.blender_addon.window.window import BlenderWindow  # noqa: E402

PICTURE_ALONE = """
space = area_of("VIEW_3D")[1].spaces.active
lines = ("show_floor", "show_ortho_grid", "show_axis_x", "show_axis_y", "show_axis_z", "show_cursor", "show_text")
for name in lines:  # one by one: the picture behind the camera is an overlay, too
    setattr(space.overlay, name, False)
space.show_gizmo = space.show_region_toolbar = space.show_region_ui = False
"""
TWO_VIEWS = """
space.overlay.show_text = space.show_gizmo = space.show_region_toolbar = space.show_region_ui = True
window, area, region = region_of("VIEW_3D", "WINDOW")
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.5)
views = sorted((a for a in window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.y)
below, above = (a.spaces.active for a in views)
above.show_object_viewport_mesh = False  # the frames alone
below.show_region_ui = below.overlay.show_overlays = below.show_gizmo = below.show_region_header = False
below.show_region_toolbar = False
"""
SEEN = """
from mathutils import Vector
module("scene.drive_scene")._fill(views[1], *scene.camera["unveil_size"])
camera = scene.camera.matrix_world
ahead = camera.to_quaternion() @ Vector((0, 0, -1))
view = below.region_3d
view.view_perspective = "PERSP"
eye = camera.translation - 7 * ahead + Vector((0, 0, 2.5))
target = camera.translation + 10 * ahead
view.view_rotation = (target - eye).to_track_quat("-Z", "Y")
view.view_location, view.view_distance = target, (target - eye).length
"""


FRAME_WIDTH = """(lambda r, v: r.width * (v.view_camera_zoom / 50 + 2**0.5) ** 2 / 4)(
    region_of("VIEW_3D", "WINDOW")[2], area_of("VIEW_3D")[1].spaces.active.region_3d)"""


def shrink(pictures: list[Path], made: Path, *options: str) -> None:
    """As JPEG of a size for pages, side by side where there are several."""
    subprocess.run(
        ["convert", *(str(p) for p in pictures), *options, "-strip", "-quality", "84", str(made)], check=True
    )


def of_work(window: BlenderWindow, out: Path, frame: int) -> None:
    """Choosing, a job that runs and a wipe: the whole window, as an artist has it."""
    window.tell(f"scene = bpy.context.scene; scene.frame_set({frame}); scene.unveil_view.state = 'BEFORE'")
    window.move(600, 900)
    time.sleep(2)
    shrink([window.picture("choose")], out / "choose.jpg", "-resize", "1280x")
    window.tell("scene.unveil_view.state = 'AFTER'; scene.unveil_view.compare = 'WIPE'")
    time.sleep(2)
    shrink([window.picture("compare")], out / "compare.jpg", "-resize", "1280x")
    window.tell("scene.unveil_view.compare = 'NONE'")
    window.tell(
        "window, area, region = region_of('VIEW_3D', 'WINDOW')\n"
        "with bpy.context.temp_override(window=window, area=area, region=region):\n"
        "    bpy.ops.unveil.stage('INVOKE_DEFAULT', stage='mesh')"
    )
    window.until("told()[2] > 0 or not session().busy", 120)
    time.sleep(1)
    shrink([window.picture("running")], out / "running.jpg", "-resize", "1280x")
    window.until("not session().busy", 300)
    time.sleep(2)


def painting(window: BlenderWindow, out: Path) -> None:
    """A clean frame in an Image Editor of its own; last, for from then on results are out of date."""
    window.tell("bpy.ops.unveil.paint_frame()")
    window.until("area_of('IMAGE_EDITOR') is not None", 20)
    time.sleep(2)
    shrink([window.picture("fix")], out / "fix.jpg", "-resize", "1280x")


def main() -> int:
    """All of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--blender", default="blender", help="command that starts Blender with its window")
    parser.add_argument("--extension", type=Path, required=True, help="the zip that make extension wrote")
    parser.add_argument("--python", default=sys.executable, help="interpreter with unveil_core's dependencies")
    parser.add_argument("--workspace", type=Path, required=True, help="of a finished run")
    parser.add_argument("--frame", type=int, default=9)
    parser.add_argument("--into", type=Path, help="folder that the pages show: the pictures are copied there")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the pictures, made anew")
    given = parser.parse_args()
    out = given.output.absolute()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    python, workspace = unveil_python(out, given.python), out / "ws"
    shutil.copytree(given.workspace, workspace)  # a stage is run again, and a frame painted on
    with BlenderWindow(given.blender, out, environ={"BLENDER_USER_RESOURCES": str(out / "user")}) as window:
        ready(window, given.extension.absolute(), python)
        window.tell(f"bpy.ops.unveil.load_workspace(directory={str(workspace)!r})")
        time.sleep(2)
        frame = 1001 + given.frame
        of_work(window, out, frame)
        window.tell(f"scene.frame_set({frame}); scene.unveil_selection.boxes = 'NONE'; scene.unveil_view.shown = set()")
        window.tell(PICTURE_ALONE)
        left, top, right, bottom = window.ask("rectangle('VIEW_3D', 'WINDOW')")
        window.tell("module('scene.drive_scene')._fill(area_of('VIEW_3D')[1], *scene.camera['unveil_size'])")
        width = window.ask(FRAME_WIDTH)
        height = width * window.ask("scene.camera['unveil_size'][1] / scene.camera['unveil_size'][0]")
        window.move(600, 900)
        time.sleep(2)
        after = window.picture("after")
        window.tell("scene.unveil_view.state = 'BEFORE'; area_of('VIEW_3D')[1].tag_redraw()")
        time.sleep(2)
        before = window.picture("before")
        x, y = (left + right - width) / 2, (top + bottom - height) / 2
        crop = f"{round(width) - 4}x{round(height) - 4}+{round(x) + 2}+{round(y) + 2}"
        shrink([before, after], out / "before_after.jpg", "-crop", crop, "+repage", "+append", "-resize", "1280x")
        window.tell("scene.unveil_view.state = 'AFTER'; scene.unveil_view.shown = {'MESH'}")
        window.tell(TWO_VIEWS)
        time.sleep(1)
        window.tell(SEEN)
        time.sleep(2)
        shrink([window.picture("result")], out / "result.jpg", "-resize", "1280x")
        painting(window, out)
    for made in sorted(out.glob("*.jpg")) if given.into is not None else ():
        shutil.copy(made, given.into / made.name)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
