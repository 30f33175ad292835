"""What must not cost an artist's work, in a real window of Blender: the worker killed, Blender killed, the disk full.

    python tests/blender_addon/window/no_lost_work.py --blender blender --extension ZIP -o OUT [--small-disk FOLDER]

FOLDER: on a disk of some tens of megabytes, as ``mount -t tmpfs -o size=64m tmpfs FOLDER`` makes it; without it that part is
left out. Each step leaves a picture; what has to be true is asserted.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from tests.blender_addon.run_in_blender import unveil_python  # noqa: E402
from tests.blender_addon.window.click_path import HELPERS, group_of, open_sidebar  # noqa: E402
from tests.blender_addon.window.window import BlenderWindow, arguments, crowded, made_anew  # noqa: E402

STATES = "{n: s.state for n, s in module('work.stage_states').stage_states(bpy.context.scene).stages.items()}"
ENDED_S = 6  # the worker has five to end by itself
"""Within which a worker must have ended after its Blender was killed."""


def ready(window: BlenderWindow, extension: Path, python: Path) -> None:
    """The add-on installed, its Python named, its sidebar open."""
    window.tell(
        f"bpy.ops.extensions.package_install_files(filepath={str(extension)!r}, repo='user_default', enable_on_install=True)"
    )
    window.tell(HELPERS)
    window.tell(f"module('work.preferences').preferences(bpy.context).python = {str(python)!r}")
    open_sidebar(window)


def unveil(window: BlenderWindow) -> int:
    """Press the button; returns the worker's process."""
    window.press_button(r"unveil.run\(")
    window.until("session().busy")
    return int(window.ask("session().job.pid"))


def until_reconstructing(window: BlenderWindow) -> None:
    window.until("told()[1] == 'reconstruct' and told()[2] > 5", 120)


def ended(window: BlenderWindow, status: str) -> list[object]:
    """What the job has told, once it has ended as expected."""
    window.until("not session().busy", 300)
    told = window.ask("told()")
    assert told[0] == status, told
    return list(told)


def worker_killed(window: BlenderWindow, drive: Path, blend: Path) -> None:
    """One clear line, and the next run goes on."""
    window.tell("bpy.data.batch_remove(bpy.data.objects); bpy.context.scene.unveil.quality = 'draft'")
    window.tell(f"bpy.ops.wm.save_as_mainfile(filepath={str(blend)!r})")
    window.tell(
        "window, area, region = region_of('VIEW_3D', 'WINDOW')\n"
        "with bpy.context.temp_override(window=window, area=area, region=region):\n"
        f"    bpy.ops.unveil.import_drive('INVOKE_DEFAULT', filepath={str(drive)!r})"
    )
    ended(window, "done")
    window.picture("0_imported")
    window.tell("bpy.ops.unveil.choose(which='VEHICLES'); bpy.ops.wm.save_mainfile()")
    pid = unveil(window)
    until_reconstructing(window)
    os.kill(pid, signal.SIGKILL)
    told = ended(window, "failed")
    print("worker killed:", told[4])
    assert "killed" in str(told[4]), told
    window.picture("1_worker_killed")


def blender_killed(window: BlenderWindow) -> None:
    """The worker ends, too."""
    pid = unveil(window)
    until_reconstructing(window)
    window.kill()
    killed = time.monotonic()
    while group_of(pid):
        assert time.monotonic() - killed < ENDED_S * crowded(), "the worker outlives its Blender"
        time.sleep(0.01)
    print(f"Blender killed: its worker ended {time.monotonic() - killed:.2f} s later")


def opened_again(window: BlenderWindow) -> None:
    """The file finds workspace and states; Unveil goes on."""
    states = window.ask(STATES)
    print("opened again:", states)
    assert states["import"] == states["choose"] == "done" and states["reconstruct"] == "to do", states
    window.picture("2_opened_again")
    unveil(window)
    ended(window, "done")
    assert set(window.ask(STATES).values()) == {"done"}, window.ask(STATES)
    window.picture("3_gone_on")


def disk_full(window: BlenderWindow, disk: Path) -> None:
    """One clear line; with room made, the same workspace goes on."""
    window.tell(f"bpy.context.scene.unveil.workspace = {str(disk / 'workspace')!r}")
    filler = disk / "filler"
    with filler.open("wb") as stream:
        stream.write(bytes(max(shutil.disk_usage(disk).free - 1_500_000, 0)))
    unveil(window)
    told = ended(window, "failed")
    print("disk full:", told[4])
    assert "disk is full" in str(told[4]), told
    window.picture("4_disk_full")
    filler.unlink()
    unveil(window)
    ended(window, "done")
    assert set(window.ask(STATES).values()) == {"done"}, window.ask(STATES)
    window.picture("5_room_made")


def main() -> int:
    """All of it."""
    parser = arguments(__doc__)
    parser.add_argument("--small-disk", type=Path, help="folder of a disk that may be filled")
    given = parser.parse_args()
    out, extension = made_anew(given.output), given.extension.absolute()
    python = unveil_python(out, given.python)
    program = "import sys, pathlib; from tests.small_street import make_small_street as m; m(pathlib.Path(sys.argv[1]))"
    subprocess.run([python, "-c", program, str(out / "street")], check=True)
    environ, blend = {"BLENDER_USER_RESOURCES": str(out / "user")}, out / "street.blend"
    with BlenderWindow(given.blender, out, environ=environ) as window:
        ready(window, extension, python)
        worker_killed(window, out / "street/transforms.json", blend)
        blender_killed(window)
    with BlenderWindow(given.blender, out, environ=environ, log="blender_again.log") as window:
        ready(window, extension, python)
        window.tell(f"bpy.ops.wm.open_mainfile(filepath={str(blend)!r})")
        open_sidebar(window)
        opened_again(window)
        if given.small_disk is not None:
            disk_full(window, given.small_disk.absolute())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
