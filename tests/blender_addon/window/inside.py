"""Runs inside Blender's window: answers what the script outside asks, between Blender's own events. See ``window.py``.

Started by ``blender --python inside.py``. It listens on a port of this machine, writes the port's number into the file that
UNVEIL_WINDOW_PORT names, and answers each line, a JSON object ``{"code": …, "value": …}``, with one of its own.
"""

import json
import os
import socket
import traceback
from pathlib import Path

import bpy

TICK_S = 0.02
SCREEN_HEIGHT = int(os.environ["UNVEIL_WINDOW_HEIGHT"])

_server = socket.create_server(("127.0.0.1", 0))
_server.setblocking(False)
_clients: list[socket.socket] = []
_held: dict[socket.socket, bytes] = {}


def area_of(kind: str):  # type: ignore[no-untyped-def]
    """(window, area): the largest area of a kind in any window, None where there is none."""
    found = [(w, a) for w in bpy.context.window_manager.windows for a in w.screen.areas if a.type == kind]
    return max(found, key=lambda pair: pair[1].width * pair[1].height, default=None)


def region_of(kind: str, region: str):  # type: ignore[no-untyped-def]
    """(window, area, region)."""
    window, area = area_of(kind)
    return window, area, next(r for r in area.regions if r.type == region)


def rectangle(kind: str, region: str) -> list[int]:
    """Left, top, right, bottom of a region on the screen, pixels, y down."""
    window, _, found = region_of(kind, region)
    left, top = window.x + found.x, SCREEN_HEIGHT - window.y - found.y - found.height
    return [left, top, left + found.width, top + found.height]


def on_screen(point) -> list[float] | None:  # type: ignore[no-untyped-def]
    """Where the viewport shows a point of the scene: x, y on the screen, y down; None if behind."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    window, area, region = region_of("VIEW_3D", "WINDOW")
    seen = location_3d_to_region_2d(region, area.spaces.active.region_3d, point)
    return None if seen is None else [window.x + region.x + seen.x, SCREEN_HEIGHT - window.y - region.y - seen.y]


def pointed_at(kind: str, region: str) -> str:
    """What the button under the pointer does: the Python of its operator, or the path of its property; else empty."""
    window, area, found = region_of(kind, region)
    manager = bpy.context.window_manager
    with bpy.context.temp_override(window=window, area=area, region=found):
        for copy in (bpy.ops.ui.copy_python_command_button, bpy.ops.ui.copy_data_path_button):
            manager.clipboard = ""
            try:
                copy()
            except RuntimeError:  # there is no such button
                continue
            if manager.clipboard:
                return manager.clipboard
    return ""


_scope = {"bpy": bpy} | {f.__name__: f for f in (area_of, region_of, rectangle, on_screen, pointed_at)}


def _answer(line: bytes) -> bytes:
    asked = json.loads(line)
    try:
        exec(asked["code"], _scope)
        value = eval(asked["value"], _scope) if asked["value"] else None
        answer = json.dumps({"value": value}, default=str)
    except Exception:
        answer = json.dumps({"error": traceback.format_exc()})
    return answer.encode() + b"\n"


def _tick() -> float:
    try:
        client, _ = _server.accept()
        client.setblocking(False)
        _clients.append(client)
        _held[client] = b""
    except BlockingIOError:
        pass
    for client in list(_clients):
        try:
            got = client.recv(1 << 20)
        except BlockingIOError:
            continue
        except OSError:
            got = b""
        if not got:
            _clients.remove(client)
            continue
        *lines, _held[client] = (_held[client] + got).split(b"\n")
        for line in lines:
            client.sendall(_answer(line))
    return TICK_S


bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(_tick, persistent=True)
_place = Path(os.environ["UNVEIL_WINDOW_PORT"])
_place.with_suffix(".new").write_text(str(_server.getsockname()[1]))
_place.with_suffix(".new").rename(_place)
