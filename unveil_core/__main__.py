"""``python -m unveil_core`` is the ``unveil`` command."""

import os
import sys

# Python has put the working folder first on the path: a torch.py beside a drive must not be taken for torch.
if not sys.flags.safe_path:
    try:
        if sys.path[:1] == [os.getcwd()]:
            del sys.path[0]
    except OSError:  # a folder that is gone: Python has not put it there
        pass

import signal

try:
    from unveil_core.app.cli import main
except KeyboardInterrupt:
    sys.exit(130)

code = main()
signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is said and written: nothing is left that could be interrupted
raise SystemExit(code)
