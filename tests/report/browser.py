"""Headless Chromium, driven over a pipe by its DevTools protocol: no library, no port, no network."""

from __future__ import annotations

import base64
import contextlib
import fcntl
import json
import math
import os
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

__all__ = ["CHROMIUM", "Tab", "opened"]

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--disable-quic",
    "--hide-scrollbars",
    "--mute-audio",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # whoever asks for a name gets none
    "--remote-debugging-pipe",
]
PATIENCE_S = 60.0


class Tab:
    """A page of the browser.

    Attributes:
        errors: of the page's console, and exceptions.
        requests: addresses that the page asked for.
    """

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from, self._rest, self._number = to_browser, from_browser, b"", 0
        self._session: str | None = None
        self._events: list[str] = []
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and wait for its answer; what is told in between is kept."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            found = self._next()
            if found.get("id") == self._number:
                assert "error" not in found, found["error"]
                return found["result"]

    def _next(self) -> dict[str, Any]:
        until = time.monotonic() + PATIENCE_S
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._from], [], [], max(0.0, until - time.monotonic()))
            part = os.read(self._from, 1 << 20) if ready else b""
            assert part, "the browser does not answer"
            self._rest += part
        whole, self._rest = self._rest.split(b"\0", 1)
        message = json.loads(whole)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, method: str, told: dict[str, Any]) -> None:
        self._events.append(method)
        if method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(told["exceptionDetails"])[:400])
        elif method == "Runtime.consoleAPICalled" and told["type"] in ("error", "assert"):
            self.errors.append(json.dumps(told["args"])[:400])
        elif method == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.errors.append(told["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"][:80])

    def open(self, path: Path) -> None:
        """Load a file and wait until it is there."""
        self._events.clear()
        self.ask("Page.navigate", url=path.resolve().as_uri())
        while "Page.loadEventFired" not in self._events:
            self._next()

    def run(self, script: str) -> Any:
        """The value of an expression in the page, awaited where it is a promise."""
        found = self.ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, script: str) -> Any:
        """Until an expression is true."""
        until = time.monotonic() + PATIENCE_S
        while not (found := self.run(script)):
            assert time.monotonic() < until, script
            time.sleep(0.05)
        return found

    def settle(self) -> None:
        """Two frames of the page later."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")

    def resize(self, width: int, height: int, scheme: str = "light") -> None:
        """The size of the window in CSS pixels, and which colours its reader prefers."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        self.settle()

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element in the window, after it was scrolled into it."""
        found = self.run(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            "e.scrollIntoView({block: 'center', behavior: 'instant'}); const b = e.getBoundingClientRect();"
            "return [b.left, b.top, b.width, b.height]; })()"
        )
        left, top, width, height = found
        return left, top, width, height

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse at a place, move it in some steps, let go."""
        self._mouse("mousePressed", start, 1)
        for share in (0.5, 1.0):
            self._mouse("mouseMoved", tuple(a + share * (b - a) for a, b in zip(start, end, strict=True)), 1)
        self._mouse("mouseReleased", end, 0)

    def _mouse(self, kind: str, at: tuple[float, ...], buttons: int) -> None:
        options = {"button": "left", "buttons": buttons, "clickCount": 1}
        self.ask("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **options)

    def press(self, key: str) -> None:
        """Press and release a key that is no letter."""
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=KEYS[key])

    def picture(self, selector: str | None = None) -> np.ndarray:
        """(H, W, 3) uint8 RGB of an element that is in the window, or of the whole page."""
        if selector is None:
            size = self.ask("Page.getLayoutMetrics")["cssContentSize"]
            clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
            taken = self.ask("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        else:
            left, top, width, height = self.place(selector)
            self.settle()
            scroll = self.run("[scrollX, scrollY]")
            # Whole pixels, halves up, as the browser counts an element's: it cuts off the last row of what ends between two.
            x, y, width, height = (math.floor(v + 0.5) for v in (left + scroll[0], top + scroll[1], width, height))
            clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
            taken = self.ask("Page.captureScreenshot", clip=clip)
        raw = np.frombuffer(base64.b64decode(taken["data"]), np.uint8)
        image = cv2.imdecode(raw, cv2.IMREAD_COLOR)
        assert image is not None
        return image[..., ::-1]


KEYS = {"ArrowLeft": 37, "ArrowRight": 39, "ArrowUp": 38, "ArrowDown": 40, "Home": 36, "Tab": 9}


@contextmanager
def opened(folder: Path, *flags: str) -> Iterator[Tab]:
    """A browser with a profile in ``folder``, for as long as the block runs."""
    assert CHROMIUM is not None
    ends = [fd for _ in range(2) for fd in os.pipe()]
    # Out of the way of 3 and 4, where the browser reads and writes.
    read_theirs, write_ours, read_ours, write_theirs = (fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 20) for fd in ends)
    for fd in ends:
        os.close(fd)

    def give() -> None:
        os.dup2(read_theirs, 3)
        os.dup2(write_theirs, 4)

    command = [CHROMIUM, *FLAGS, *flags, f"--user-data-dir={folder}", "about:blank"]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        preexec_fn=_both(os.setsid, give), close_fds=False,
    )  # fmt: skip
    os.close(read_theirs)
    os.close(write_theirs)
    try:
        yield Tab(write_ours, read_ours)
    finally:
        os.close(write_ours)  # it ends by itself when nobody talks to it any more
        os.close(read_ours)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, 9)
            process.wait()


def _both(*calls: Callable[[], Any]) -> Callable[[], None]:
    def call() -> None:
        for one in calls:
            one()

    return call
