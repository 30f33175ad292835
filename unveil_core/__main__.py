"""``python -m unveil_core`` is the ``unveil`` command."""

import signal
import sys

try:
    from unveil_core.app.cli import main
except KeyboardInterrupt:
    sys.exit(130)

code = main()
signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is said and written: nothing is left that could be interrupted
raise SystemExit(code)
