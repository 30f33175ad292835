"""How a solve reports: events as those of a run."""

from __future__ import annotations

import time
from collections.abc import Callable

from unveil_core.base.progress import Progress

__all__ = ["Events", "Reporter"]

Reporter = Callable[[dict[str, object]], None]


class Events:
    """Progress and notices of the steps, as events of a run."""

    def __init__(self, reporter: Reporter) -> None:
        self.reporter, self.notices = reporter, list[str]()

    def _event(self, stage: str, message: str, level: str, done: int = 0, total: int = 0, **more: float) -> None:
        event = {"t": round(time.time(), 3), "stage": stage, "done": done, "total": total, "message": message}
        self.reporter({**event, "level": level, **more})

    def progress(self, stage: str) -> Progress:
        def told(done: int, total: int, message: str = "", **metrics: float) -> None:
            self._event(stage, message, "info", done, total, **metrics)

        return told

    def begin(self, stage: str) -> Progress:
        self._event(stage, "started", "info")
        return self.progress(stage)

    def end(self, stage: str, message: str = "done") -> None:
        self._event(stage, message, "info")

    def notice(self, stage: str, line: str, level: str = "notice") -> None:
        if line not in self.notices:
            self.notices.append(line)
            self._event(stage, line, level)
