"""A real window of Blender on a screen of its own, with a pointer, keys and pictures.

Clicks and keys are real events of the X server (xdotool). What the script needs to know, as where a button is, it asks a
small server inside Blender (``inside.py``). Buttons cannot be asked for their place: the pointer looks for them.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["BlenderWindow", "arguments", "crowded", "made_anew"]

HERE = Path(__file__).resolve().parent
PLAIN_WINDOWS = """<openbox_config xmlns="http://openbox.org/3.4/rc">
<applications><application class="*"><decor>no</decor><focus>yes</focus></application></applications>
</openbox_config>"""
"""Without title bars the window's pixels are the screen's."""
STEP_PX = 9
"""Between two places that are looked at for a button: half a row."""


def arguments(told: str | None) -> argparse.ArgumentParser:
    """What every script takes.

    Args:
        told: the script's docstring.
    """
    parser = argparse.ArgumentParser(description=(told or "").splitlines()[0])
    parser.add_argument("--blender", default="blender", help="command that starts Blender with its window")
    parser.add_argument("--extension", type=Path, required=True, help="the zip that make extension wrote")
    parser.add_argument("--python", default=sys.executable, help="interpreter with unveil_core's dependencies")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of pictures and figures, made anew")
    return parser


def crowded() -> float:
    """How many times longer things may take than on an idle machine: all wait for a processor, Blender, too."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def made_anew(folder: Path) -> Path:
    """The folder, empty."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder.absolute()


class BlenderWindow:
    """Blender in a window that fills its screen.

    Attributes:
        out: folder of the pictures and of Blender's output.
        pid: of the process that was started.
    """

    def __init__(
        self,
        blender: str,
        out: Path,
        *,
        arguments: list[str] | None = None,
        size: tuple[int, int] = (1600, 1000),
        environ: dict[str, str] | None = None,
        log: str = "blender.log",
    ) -> None:
        """Start both.

        Args:
            blender: command that starts Blender, as a shell would read it.
            out: an existing folder, seen by Blender under the same path.
            arguments: for Blender, as the .blend to open.
            size: of the screen, pixels.
            environ: beyond this process's.
            log: name of the file for Blender's output.
        Raises:
            RuntimeError: a program is missing, or Blender does not answer within a minute.
        """
        for program in ("Xvfb", "xdotool", "import"):
            if shutil.which(program) is None:
                raise RuntimeError(f"{program} is missing (install xvfb, xdotool and imagemagick)")
        self.out, self.size = out, size
        number = next(n for n in range(90, 200) if not Path(f"/tmp/.X11-unix/X{n}").exists())
        self._environ = {**os.environ, "DISPLAY": f":{number}"}
        self._programs = [self._start("Xvfb", f":{number}", "-screen", "0", f"{size[0]}x{size[1]}x24", "-noreset")]
        _until(lambda: Path(f"/tmp/.X11-unix/X{number}").exists(), 10, "the X server")
        if shutil.which("openbox"):  # without a window manager no window gets the keys
            plain = out / "openbox.xml"
            plain.write_text(PLAIN_WINDOWS)
            self._programs.append(self._start("openbox", "--config-file", str(plain)))
        port = out / "port"
        port.unlink(missing_ok=True)
        software = {"LIBGL_ALWAYS_SOFTWARE": "1", "GALLIUM_DRIVER": "llvmpipe"}
        self._log = (out / log).open("w")
        self._blender = subprocess.Popen(
            [
                *shlex.split(blender),
                "--factory-startup",
                "-p",
                "0",
                "0",
                str(size[0]),
                str(size[1]),
                *(arguments or []),
                "--python",
                str(HERE / "inside.py"),
            ],
            env={
                **self._environ,
                **software,
                **(environ or {}),
                "UNVEIL_WINDOW_PORT": str(port),
                "UNVEIL_WINDOW_HEIGHT": str(size[1]),
            },
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        _until(lambda: port.exists() or self._blender.poll() is not None, 60, "Blender")
        if self._blender.poll() is not None:
            raise RuntimeError(f"Blender ended with {self._blender.poll()}: {(out / log).read_text()[-2000:]}")
        self._socket = socket.create_connection(("127.0.0.1", int(port.read_text())), timeout=120)
        self._answers = self._socket.makefile("rb")

    def _start(self, *command: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            command, env=self._environ, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    @property
    def pid(self) -> int:
        return self._blender.pid

    # ------------------------------------------------------------------------------------------------------------- questions

    def ask(self, value: str, code: str = "") -> Any:
        """Run ``code`` inside Blender and return the JSON of an expression."""
        self._socket.sendall(json.dumps({"code": code, "value": value}).encode() + b"\n")
        line = self._answers.readline()
        if not line:
            raise RuntimeError(f"Blender has gone: {(self.out / 'blender.log').read_text()[-2000:]}")
        answer = json.loads(line)
        if "error" in answer:
            raise RuntimeError(answer["error"])
        return answer["value"]

    def tell(self, code: str) -> None:
        """Run code inside Blender."""
        self.ask("", code)

    def until(self, value: str, timeout_s: float = 60, every_s: float = 0.05) -> Any:
        """Ask until the answer is true."""
        return _until(lambda: self.ask(value), timeout_s, value, every_s)

    # --------------------------------------------------------------------------------------------------------------- events

    def _events(self, *arguments: object) -> None:
        subprocess.run(["xdotool", *(str(a) for a in arguments)], env=self._environ, check=True, timeout=20)

    def move(self, x: float, y: float) -> None:
        """Move the pointer; y down."""
        self._events("mousemove", round(x), round(y))

    def click(self, x: float, y: float, button: int = 1) -> None:
        """Click like a hand: the pointer arrives, rests, presses, and lets go."""
        for away in (60, 30, 8, 2, 0):  # a pointer that jumps is not always noticed
            self._events("mousemove", max(round(x) - away, 0), round(y), "sleep", 0.05)
        time.sleep(0.3)
        self._events("mousedown", button, "sleep", 0.08, "mouseup", button)
        time.sleep(0.4)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """From one place to another with the left button held, as a brush goes."""
        self.move(*start)
        time.sleep(0.3)
        self._events("mousedown", 1, "sleep", 0.1)
        for k in range(1, 13):
            x, y = (a + (b - a) * k / 12 for a, b in zip(start, end, strict=True))
            self._events("mousemove", round(x), round(y), "sleep", 0.05)
        self._events("mouseup", 1)
        time.sleep(0.4)

    def press(self, *keys: str) -> None:
        """Press keys one after another, as ``Escape``, ``ctrl+z``."""
        for key in keys:
            self._events("key", key)
            time.sleep(0.1)

    def type(self, text: str) -> None:
        """Type; a line break is the Return key."""
        self._events("type", "--delay", 15, text)
        time.sleep(0.3)

    def scroll(self, x: float, y: float, clicks: int) -> None:
        """Turn the wheel there; down where positive."""
        self.move(x, y)
        self._events("click", "--repeat", abs(clicks), "--delay", 30, 5 if clicks > 0 else 4)
        time.sleep(0.6)  # Blender scrolls smoothly

    def picture(self, name: str) -> Path:
        """The whole screen, as ``out/NAME.png``."""
        time.sleep(0.5)
        path = self.out / f"{name}.png"
        subprocess.run(["import", "-window", "root", str(path)], env=self._environ, check=True, timeout=30)
        return path

    # -------------------------------------------------------------------------------------------------------------- buttons

    def find(self, what: str, *, area: str = "VIEW_3D", region: str = "UI", across: float = 0.5) -> tuple[float, float]:
        """Where the button is in the Python of whose operator or property the pattern ``what`` is found, as ``unveil.run``.

        The pointer goes down the region, which is scrolled as far as needed.

        Args:
            across: where between the left (0) and the right border (1).
        Raises:
            RuntimeError: it is not there.
        """
        left, top, right, bottom = self.ask(f"rectangle({area!r}, {region!r})")
        x = left + across * (right - left)
        self.scroll(left + 4, (top + bottom) / 2, -60)  # in the margin: over a list, the list would turn
        seen: list[str] = []
        for _ in range(6):
            for y in range(int(top) + 4, int(bottom) - 3, STEP_PX):
                self.move(x, y)
                found = self.ask(f"pointed_at({area!r}, {region!r})")
                if re.search(what, found):
                    return x, y + 3  # inside, not on its border
                if found and found not in seen:
                    seen.append(found)
            self.scroll(left + 4, (top + bottom) / 2, 8)
        raise RuntimeError(f"no button {what} in {area} {region}; there are {seen}")

    def press_button(self, what: str, **where: Any) -> None:
        """Find it and click it."""
        self.click(*self.find(what, **where))

    # ----------------------------------------------------------------------------------------------------------------- end

    def kill(self) -> None:
        """As when the machine is out of memory: no time for anything."""
        os.killpg(self.pid, signal.SIGKILL)
        self._blender.wait(10)

    def close(self) -> None:
        """Quit Blender, as by its menu, and end the screen."""
        if self._blender.poll() is None:
            try:
                self._socket.sendall(json.dumps({"code": "bpy.ops.wm.quit_blender()", "value": ""}).encode() + b"\n")
                self._blender.wait(15)
            except (OSError, subprocess.TimeoutExpired):
                self.kill()
        for program in reversed(self._programs):
            program.terminate()
            program.wait(10)
        self._log.close()

    def __enter__(self) -> BlenderWindow:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _until(condition: Callable[[], Any], timeout_s: float, what: str, every_s: float = 0.05) -> Any:
    deadline = time.monotonic() + timeout_s
    while not (found := condition()):
        if time.monotonic() > deadline:
            raise RuntimeError(f"{what}: not within {timeout_s:g} s")
        time.sleep(every_s)
    return found
