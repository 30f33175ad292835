"""Fuzzing guided by coverage: one reader, for as long as it is given, by Atheris (``pip install atheris``).

    python benchmarks/robustness/fuzz_guided.py READER [--minutes 10] [--corpus DIR] [--findings DIR]

``fuzz.py`` changes sound files by what is known of their structure; this one knows nothing of them, and keeps each input
that reaches another line of the readers. Both judge alike (tests/fuzz/verdict.py). It ends at the first input that goes wrong,
which is written to ``--findings`` with its trace. Of a reader of several files one input changes one, which its first byte
chooses.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

LONGEST = 1 << 16
"""Bytes of an input: headers and tables are all that a longer one would repeat."""
SLOW_S = 20
"""Seconds after which an input counts as a hang, instrumented."""
MEMORY_MB = 2048


def main() -> None:
    """Try one reader."""
    try:
        import atheris
    except ImportError:
        raise SystemExit("this needs Atheris: pip install atheris") from None
    with atheris.instrument_imports(include=["unveil_core", "blender_addon"]):
        from tests.fuzz.table import READERS
        from tests.fuzz.verdict import Finding, judged
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reader", choices=list(READERS), metavar="READER", help=", ".join(READERS))
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--corpus", type=Path, help="where inputs that reach something new are kept for the next time")
    parser.add_argument("--findings", type=Path, default=Path(tempfile.gettempdir()) / "unveil_fuzz_guided")
    arguments = parser.parse_args()
    reader = READERS[arguments.reader]
    with tempfile.TemporaryDirectory(prefix="fuzz_guided_") as folder:
        opened = reader.prepare(Path(folder) / "files")
        originals = [file.read_bytes() for file in opened.files]
        corpus, findings = arguments.corpus or Path(folder) / "corpus", arguments.findings / reader.name.replace("/", "_")
        for place in (corpus, findings):
            place.mkdir(parents=True, exist_ok=True)
        for k, content in enumerate(originals):
            (corpus / f"sound_{k}").write_bytes(bytes([k]) + content)

        def one(data: bytes) -> None:
            if not data:
                return
            k = data[0] % len(originals)
            opened.files[k].write_bytes(data[1:])
            verdict = judged(reader, opened, opened.files[k])
            opened.files[k].write_bytes(originals[k])
            if isinstance(verdict, Finding):
                (findings / opened.files[k].name).write_bytes(data[1:])
                (findings / "trace.txt").write_text(f"{verdict.kind}: {verdict.where}\n{verdict.trace}")
                raise AssertionError(f"{verdict.kind}: {verdict.where}")

        options = {
            "max_total_time": round(60 * arguments.minutes), "max_len": LONGEST, "timeout": SLOW_S,
            "rss_limit_mb": MEMORY_MB, "artifact_prefix": f"{findings}/", "print_final_stats": 1,
        }  # fmt: skip
        atheris.Setup([sys.argv[0], str(corpus), *(f"-{name}={value}" for name, value in options.items())], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
