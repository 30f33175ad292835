"""Ask whether holes are known in the packages of the lock files, by pip-audit, where its advisories can be reached.

    python requirements/audit.py PIP_AUDIT

Without a network, or with an index that has no advisories, one line says that nothing was looked up, and the answer is 0: machines
without a network lint as well. A known hole is 1.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
LOCKS = ("core", "torch", "dev", "build", "bpy-5.0")
"""What users and tests get. Those of the older Blenders hold what their Blender does."""
WAIT_S = 120


def judged(packages: Sequence[dict[str, Any]]) -> tuple[int, list[str]]:
    """Exit code and lines of what pip-audit found of some packages."""
    skipped = [p for p in packages if "skip_reason" in p]
    known = [
        f"{p['name']} {p['version']}: {hole['id']}, mended in {', '.join(hole.get('fix_versions') or ['no version'])}"
        for p in packages
        for hole in p.get("vulns", [])
    ]
    if known:
        return 1, known
    if not packages or len(skipped) == len(packages):
        return 0, ["nothing was looked up: the index that was asked has no advisories"]
    left = f"; {len(skipped)} are not known there" if skipped else ""
    return 0, [f"no holes are known in {len(packages) - len(skipped)} packages{left}"]


def main(arguments: Sequence[str]) -> int:
    """Print what is known; 1 if anything is."""
    found: list[dict[str, Any]] = []
    try:
        for name in LOCKS:  # one by one: two of them may have two versions of a package
            lock = f"--requirement={HERE / name}.txt"
            command = [arguments[0], "--disable-pip", "--progress-spinner=off", "--format=json", lock]
            done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S)
            found += json.loads(done.stdout)["dependencies"]
        code, lines = judged(found)
    except (OSError, ValueError, LookupError, TypeError, subprocess.TimeoutExpired):
        code, lines = 0, ["nothing was looked up: there is no pip-audit here, or no network"]
    print("\n".join(f"known holes: {line}" for line in lines))
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
