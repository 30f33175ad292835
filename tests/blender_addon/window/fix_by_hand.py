"""From an import to a mended frame, in a real window of Blender: choose, preview, run, paint on a clean frame, redo.

    python tests/blender_addon/window/fix_by_hand.py --blender blender --extension ZIP --drive DRIVE -o OUT [--quality draft]

Each step leaves a picture; what was measured is in ``OUT/fix_by_hand.json``. The stroke goes over the middle of what was removed.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from tests.blender_addon.run_in_blender import unveil_python  # noqa: E402
from tests.blender_addon.window.no_lost_work import ended, ready  # noqa: E402
from tests.blender_addon.window.window import BlenderWindow, arguments, made_anew  # noqa: E402

HELPERS = """
import numpy as np
def shown():
    # name and picture of the frame that the scene's camera shows
    scene = bpy.context.scene
    drive = module("formats.drive_files").read_drive(scene.unveil.workspace)
    timeline = module("formats.timeline").timeline_of(drive, scene.unveil.start_frame)
    track = scene.camera["unveil_track"]
    frames = drive.tracks[track]
    return [track, frames[timeline.at(track, scene.frame_current)].name, len(frames)]
def levels(path):
    image = bpy.data.images.load(path)
    found = np.zeros(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(found)
    size = tuple(image.size)
    plane = found.reshape(size[1], size[0], image.channels)[::-1, :, :3]
    bpy.data.images.remove(image)
    return plane
def differing(a, b):
    return float((np.abs(levels(a) - levels(b)).max(axis=2) > 0.02).mean())
def middle_of(path):
    # where a mask is, as shares of width and height from the lower left
    mask = levels(path)[..., 0] > 0.5
    rows, columns = np.nonzero(mask)
    return [float(np.median(columns)) / mask.shape[1], 1 - float(np.percentile(rows, 70)) / mask.shape[0]]
def brush(pixels, color):
    paint = bpy.context.scene.tool_settings
    own = getattr(paint.image_paint, "unified_paint_settings", None) or paint.unified_paint_settings
    own.use_unified_size, own.use_unified_color, own.size = True, True, pixels
    own.color = color
def image_on_screen(x, y):
    left, top, right, bottom = rectangle("IMAGE_EDITOR", "WINDOW")
    at = region_of("IMAGE_EDITOR", "WINDOW")[2].view2d.view_to_region(x, y, clip=False)
    return [left + at[0], bottom - at[1]]
"""


def timed(window: BlenderWindow, button: str, limit_s: float) -> float:
    """Press a button that starts a job, and wait until it has done its work."""
    window.press_button(button, across=0.3)  # the left one of a row of two
    started = time.monotonic()
    window.until("session().busy", 20)
    window.until("not session().busy", limit_s, 0.5)
    told = window.ask("told()")
    assert told[0] == "done", told
    return round(time.monotonic() - started, 1)


def painted(window: BlenderWindow, mask: Path) -> None:
    """A stroke of the default brush, across what was removed."""
    window.press_button("unveil.paint_frame")
    window.until("area_of('IMAGE_EDITOR') is not None", 20)
    time.sleep(2)
    window.tell(
        "window, area, region = region_of('IMAGE_EDITOR', 'WINDOW')\n"
        "with bpy.context.temp_override(window=window, area=area, region=region):\n    bpy.ops.image.view_all(fit_view=True)"
    )
    time.sleep(1)
    window.tell("brush(46, (0.32, 0.33, 0.36))")
    x, y = window.ask(f"middle_of({str(mask)!r})")
    left, across = window.ask(f"image_on_screen({x}, {y})"), window.ask(f"image_on_screen({min(x + 0.08, 0.98)}, {y})")
    window.picture("05_paint")
    window.drag(left, across)
    time.sleep(1)
    window.picture("06_painted")
    assert window.ask("any(f.image.is_dirty for f in bpy.context.scene.unveil_selection.fixes)"), (
        "the stroke left nothing"
    )
    window.tell("with bpy.context.temp_override(window=area_of('IMAGE_EDITOR')[0]): bpy.ops.wm.window_close()")
    time.sleep(1)


def main() -> int:
    """All of it."""
    parser = arguments(__doc__)
    parser.add_argument("--drive", type=Path, default=ROOT / "sample_scenes/parked_street/transforms.json")
    parser.add_argument("--workspace", type=Path, help="of that drive and quality, run before: it is gone on with")
    parser.add_argument("--quality", default="draft", choices=("draft", "standard", "high"))
    parser.add_argument("--frames", default="", help="part of the drive, as the command takes it")
    parser.add_argument(
        "--frame", type=int, default=0, help="number of the frame that is mended; by default the middle one"
    )
    given = parser.parse_args()
    out = made_anew(given.output)
    python, root = unveil_python(out, given.python), out / "ws"
    if given.workspace is not None:
        shutil.copytree(given.workspace, root)
    environ = {"BLENDER_USER_RESOURCES": str(out / "user")}
    with BlenderWindow(given.blender, out, environ=environ, size=(1920, 1200)) as window:
        ready(window, given.extension.absolute(), python)
        window.tell(HELPERS)
        window.tell(f"bpy.data.batch_remove(bpy.data.objects); bpy.context.scene.unveil.frames = {given.frames!r}")
        window.tell(
            "window, area, region = region_of('VIEW_3D', 'WINDOW')\n"
            "with bpy.context.temp_override(window=window, area=area, region=region):\n"
            f"    bpy.ops.unveil.import_drive('INVOKE_DEFAULT', filepath={str(given.drive.absolute())!r}, workspace={str(root)!r})"
        )
        ended(window, "done")
        track, _, count = window.ask("shown()")
        window.tell(f"bpy.context.scene.frame_set(1001 + {given.frame or count // 2})")
        time.sleep(1)
        window.picture("01_imported")
        window.press_button(r"unveil.choose\(which='VEHICLES'", across=0.12)
        window.tell(f"bpy.context.scene.unveil.quality = {given.quality!r}")
        window.picture("02_chosen")
        measured = {"frames": count, "quality": given.quality, "preview_s": timed(window, r"unveil.preview\(", 400)}
        window.tell("bpy.context.scene.unveil_view.shown = set()")
        time.sleep(1)
        window.picture("03_preview")
        measured["run_s"] = timed(window, r"unveil.run\(", 3000)
        window.tell("bpy.context.scene.unveil_view.shown = set()")
        time.sleep(1)
        window.picture("04_clean")
        name = window.ask("shown()")[1]
        shutil.copytree(root / "frames", out / "before")
        painted(window, root / "masks/removed" / track / f"{name}.png")
        measured["redo_s"] = timed(window, r"unveil.run\(\)|unveil.run\b", 3000)
        time.sleep(1)
        window.picture("07_redone")
        changed = {
            p.stem: window.ask(f"differing({str(p)!r}, {str(out / 'before' / track / p.name)!r})")
            for p in sorted((root / "frames" / track).glob("*.png"))
        }
        assert changed[name] > 0 and sum(v > 0 for v in changed.values()) > 2, changed
        measured["frames_that_followed"] = sum(v > 0.0001 for v in changed.values())
        window.tell(f"bpy.ops.wm.save_as_mainfile(filepath={str(out / 'street.blend')!r})")
    (out / "fix_by_hand.json").write_text(json.dumps(measured, indent=2) + "\n")
    print(json.dumps(measured, indent=2))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
