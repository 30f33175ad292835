"""How long a big drive takes to load and to draw, in a real window of Blender.

    python tests/blender_addon/window/redraws.py --blender blender --extension ZIP -o OUT [--workspace WS]

WS: that ``benchmarks/blender/big_workspace.py`` wrote; made where it is not named. ``OUT/redraws.json`` tells milliseconds of a
redraw of the sidebar and of the 3D view, of a new file and of the drive; without a graphics card the view is drawn by the
processor.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from tests.blender_addon.run_in_blender import unveil_python  # noqa: E402
from tests.blender_addon.window.click_path import open_sidebar  # noqa: E402
from tests.blender_addon.window.no_lost_work import ready  # noqa: E402
from tests.blender_addon.window.window import BlenderWindow, arguments, made_anew  # noqa: E402

LONGEST_SIDEBAR_MS, LONGEST_LOAD_S = 20, 10
HELPERS = """
import time
def drawn_ms(region, count=20):
    window, area, found = region_of("VIEW_3D", region)
    with bpy.context.temp_override(window=window, area=area, region=found):
        bpy.ops.wm.redraw_timer(type="DRAW", iterations=2)
        started = time.perf_counter()
        bpy.ops.wm.redraw_timer(type="DRAW", iterations=count)
    return round(1000 * (time.perf_counter() - started) / count, 2)
def loaded_s(folder):
    started = time.perf_counter()
    bpy.ops.unveil.load_workspace(directory=folder)
    return round(time.perf_counter() - started, 2)
"""


def main() -> int:
    """All of it."""
    parser = arguments(__doc__)
    parser.add_argument("--workspace", type=Path, help="of a big drive")
    given = parser.parse_args()
    out = made_anew(given.output)
    python = unveil_python(out, given.python)
    workspace = given.workspace or out / "big"
    if given.workspace is None:
        subprocess.run([python, str(ROOT / "benchmarks/blender/big_workspace.py"), str(workspace)], check=True)
    with BlenderWindow(given.blender, out, environ={"BLENDER_USER_RESOURCES": str(out / "user")}) as window:
        ready(window, given.extension.absolute(), python)
        window.tell(HELPERS)
        told = {
            "blender": window.ask("bpy.app.version_string"),
            "cores": os.cpu_count(),
            "load": round(os.getloadavg()[0], 1),
        }
        regions = {"sidebar_ms": "UI", "view_ms": "WINDOW"}
        told["new_file"] = {name: window.ask(f"drawn_ms({region!r})") for name, region in regions.items()}
        told["load_s"] = window.ask(f"loaded_s({str(workspace.absolute())!r})")
        open_sidebar(window)
        window.picture("loaded")
        shown = {"points": "{'POINTS'}", "mesh": "{'MESH'}", "gaussians": "{'SPLATS'}", "nothing": "set()"}
        for name, what in shown.items():
            window.tell(f"bpy.context.scene.unveil_view.shown = {what}")
            time.sleep(1)
            told[name] = {key: window.ask(f"drawn_ms({region!r})") for key, region in regions.items()}
        window.tell(f"bpy.ops.wm.save_as_mainfile(filepath={str(out / 'big.blend')!r}, compress=False)")
        told["blend_mb"] = round((out / "big.blend").stat().st_size / 1e6)
    (out / "redraws.json").write_text(json.dumps(told, indent=2) + "\n")
    print(json.dumps(told, indent=2))
    assert told["load_s"] < LONGEST_LOAD_S, told["load_s"]
    assert max(told[name]["sidebar_ms"] for name in shown) < LONGEST_SIDEBAR_MS, told
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
