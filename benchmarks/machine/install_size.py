"""How much disk the installed packages take: those of the core, and what each extra adds.

    python benchmarks/machine/install_size.py

Of the environment that runs this, by the files that its packages list; results go to benchmarks/results/install.json.
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import Distribution
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from requirements.licences import groups, reached  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = ROOT / "benchmarks" / "results" / "install.json"
EXTRAS = ("solve", "exports", "plates", "datasets", "farm")


def megabytes(packages: dict[str, Distribution]) -> float:
    """Of all files that the packages list and that are there."""
    files = [Path(str(p.locate_file(file))) for p in packages.values() for file in p.files or ()]
    return round(sum(path.stat().st_size for path in files if path.is_file()) / 1e6, 1)


def main() -> None:
    """Measure and write."""
    asked = groups()
    core = reached(asked[""])
    extras = {extra: {k: v for k, v in reached(asked[extra]).items() if k not in core} for extra in EXTRAS}
    document = {
        "machine": machine(),
        "torch": core["torch"].version,
        "packages": len(core),
        "core_mb": megabytes(core),
        "extras_mb": {extra: megabytes(packages) for extra, packages in extras.items()},
    }
    RESULTS.write_text(json.dumps(document, indent=1) + "\n")
    print(json.dumps(document["extras_mb"]), document["core_mb"])


if __name__ == "__main__":
    main()
