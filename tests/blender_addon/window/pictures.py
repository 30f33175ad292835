"""Pictures of a finished workspace in Blender's window: frame before and after, and the mesh beside it.

    python tests/blender_addon/window/pictures.py --blender blender --extension ZIP --workspace WORKSPACE -o OUT [--frame 9]

Made for readers, not for tests: nothing is asserted.
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

TWO_VIEWS = """
window, area, region = region_of("VIEW_3D", "WINDOW")
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.48)
views = sorted((a for a in window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.y)
below, above = (a.spaces.active for a in views)
above.show_object_viewport_mesh = False  # the frames alone
below.show_region_ui = below.overlay.show_overlays = below.show_gizmo = below.show_region_header = False
"""
FROM_ABOVE = """
from mathutils import Matrix, Vector
camera = bpy.context.scene.camera.matrix_world
ahead = camera.to_quaternion() @ Vector((0, 0, -1))
view = below.region_3d
view.view_perspective = "PERSP"
eye = camera.translation - 4 * ahead + Vector((0, 0, 7))
target = camera.translation + 14 * ahead
view.view_rotation = (target - eye).to_track_quat("-Z", "Y")
view.view_location, view.view_distance = target, (target - eye).length
"""


def shrink(pictures: list[Path], made: Path, *options: str) -> None:
    """As JPEG of a size for pages, side by side where there are several."""
    subprocess.run(
        ["convert", *(str(p) for p in pictures), *options, "-strip", "-quality", "84", str(made)], check=True
    )


def main() -> int:
    """All of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--blender", default="blender", help="command that starts Blender with its window")
    parser.add_argument("--extension", type=Path, required=True, help="the zip that make extension wrote")
    parser.add_argument("--python", default=sys.executable, help="interpreter with unveil_core's dependencies")
    parser.add_argument("--workspace", type=Path, required=True, help="of a finished run")
    parser.add_argument("--frame", type=int, default=9)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the pictures, made anew")
    given = parser.parse_args()
    out = given.output.absolute()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    python = unveil_python(out, given.python)
    with BlenderWindow(given.blender, out, environ={"BLENDER_USER_RESOURCES": str(out / "user")}) as window:
        ready(window, given.extension.absolute(), python)
        window.tell("bpy.data.batch_remove(bpy.data.objects)")
        window.tell(f"bpy.ops.unveil.load_workspace(directory={str(given.workspace.absolute())!r})")
        window.tell(
            f"scene = bpy.context.scene; scene.frame_set({given.frame}); scene.unveil_selection.show_boxes = False"
        )
        window.move(600, 700)
        time.sleep(2)
        left, top, right, bottom = window.ask("rectangle('VIEW_3D', 'WINDOW')")
        covered = window.ask("region_of('VIEW_3D', 'UI')[2].width")
        after = window.picture("after")
        window.tell("scene.unveil_view.state = 'BEFORE'")
        before = window.picture("before")
        crop = f"{right - left - covered - 80}x{bottom - top - 200}+{left + 40}+{top + 120}"
        shrink([before, after], out / "before_after.jpg", "-crop", crop, "+repage", "-append", "-resize", "900x")
        window.tell("scene.unveil_view.state = 'AFTER'; scene.unveil_view.shown = {'MESH'}")
        window.tell(TWO_VIEWS)
        time.sleep(1)
        window.tell(FROM_ABOVE)
        time.sleep(2)
        shrink([window.picture("result")], out / "result.jpg", "-resize", "1280x")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
