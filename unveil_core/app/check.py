"""``unveil check``: a drive looked at before the wait, as a page and as lines."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from unveil_core.app.console import reporting_for, say
from unveil_core.app.footage.solve import refuse_clip
from unveil_core.app.given_settings import settings_of

__all__ = ["run_check"]

NAMED = 60
"""Characters of the drive's name that the page's file keeps."""


def run_check(arguments: argparse.Namespace) -> int:
    """Look at a drive, write the page, say what looks wrong; 2 where a run would not begin without being told to."""
    from unveil_core.base.disk.rights import keep_rights
    from unveil_core.base.files import write_bytes_atomic
    from unveil_core.base.output.single_files import of_user, whole_file
    from unveil_core.checkup.examined import examine_drive
    from unveil_core.checkup.page import check_page
    from unveil_core.pipeline.output_place import check_file_place

    refuse_clip(arguments.drive)
    page = arguments.output or Path(f"check_{_plain(arguments.drive)}.html")
    page = page if page.suffix.lower() in (".html", ".htm") else page / "check.html"
    check_file_place(page, [arguments.drive])
    receipts = of_user(replace=arguments.replace)
    receipts.check(page)
    with reporting_for(arguments) as reporter:

        def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
            event = {"t": round(time.time(), 3), "stage": "check", "done": done, "total": total, "message": message}
            reporter({**event, "level": "info", **metrics})

        found = examine_drive(arguments.drive, settings_of(arguments), progress)
    with whole_file(page, receipts) as made:
        write_bytes_atomic(made, check_page(found).encode("utf-8", "replace"))
        keep_rights([made], found.rights)
    if arguments.json:
        told = {
            "page": str(page),
            "facts": dict(found.facts),
            "assumed": [*found.assumed, *found.told],
            "exit_code": 2 if found.asks and not arguments.yes else 0,
            "findings": [{"problem": f.problem, "mend": f.mend, "asks": f.asks} for f in found.findings],
        }
        say(json.dumps({"check": told}))
    else:
        for key, value in found.facts:
            say(f"{key:<22} {value}")
        for line in (*found.assumed, *found.told):
            say(f"assumed                {line}")
        for finding in found.findings:
            say(f"LOOK                   {finding.line}")
        say(f"looks wrong            {len(found.findings) or 'nothing'}")
        say(page)
    if found.asks and not arguments.yes:
        say(f"unveil: error: a run of {arguments.drive} asks before it begins: {found.findings[0].line}", sys.stderr)
        return 2
    return 0


def _plain(drive: Path) -> str:
    """A drive's name as part of a file's."""
    whole = drive.absolute()
    name = whole.parent.name if whole.suffix.lower() == ".json" else whole.name
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)[:NAMED] or "drive"
