"""End with the program that started this one: when standard input closes, the work is cancelled.

The other end of the pipe closes however that program ends, also when it is killed; that holds on every system.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time

__all__ = ["end_with_stdin"]

PATIENCE_S = 5.0
"""What the work has to end by itself once standard input has closed. The workspace survives a harder end, too."""


def end_with_stdin(exit_code: int = 130) -> None:
    """From now on, the end of standard input acts as an interrupt; work that does not heed it is ended after a while."""
    threading.Thread(target=_watch, args=(exit_code,), name="stdin-watch", daemon=True).start()


def _watch(exit_code: int) -> None:
    try:
        while os.read(sys.stdin.fileno(), 4096):
            pass
    except (OSError, ValueError, AttributeError):
        pass  # there is none to watch
    if sys.platform == "win32":
        _thread.interrupt_main(signal.SIGINT)
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)  # wakes it where it waits, too
    time.sleep(PATIENCE_S)
    os._exit(exit_code)
