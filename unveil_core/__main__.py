"""``python -m unveil_core`` is the ``unveil`` command."""

from unveil_core.app.cli import main

raise SystemExit(main())
