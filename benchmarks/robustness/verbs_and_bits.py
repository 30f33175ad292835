"""Single verbs that are killed, and results in which a bit turns over: nothing is lost, nothing is left, no damage goes out unsaid.

    python benchmarks/robustness/verbs_and_bits.py [--solve 20] [--mask 10] [--export 20] [--flips 210] [--seed 0]

Kills: `solve` of a part of the sample clip, `mask` on the sample street and `export` of its run are killed with SIGKILL at moments
drawn over the time that they take undisturbed, half of them onto an earlier result, and called again. Then the files must be those
of a call that nobody killed (of a solve those that COLMAP's threads leave alone: frames, labels), and nothing else may lie there.

Bits: in files of a finished run, drawn evenly over its kinds of files, a bit turns over, with the time put back in a third of the
cases; half of a file is gone; or some bytes are zero. Then `status` must name a stage that is not up to date, or the file is one
that nothing reads; and an export of everything must refuse in one line, or hold the same bytes as that of the whole run.
Results go to benchmarks/results/verbs_and_bits.json.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402

RESULTS = ROOT / "benchmarks/results/verbs_and_bits.json"
CLIP = ROOT / "sample_scenes/phone_clip"
STREET = ROOT / "sample_scenes/parked_street"
FORMATS = "splat-ply,png,nerfstudio,colmap,mattes"
LEFT_OUT = {".lock", ".unveil.json", "export.json", "clicks.json", ".exports.json", ".digests.json"}
"""What holds times, and marks of nothing."""
OF_CHANCE = ("solve", "transforms.json", "points.ply", "sparse", "solve.html", "solve.json")
"""What of a solve follows from COLMAP's threads."""
UNREAD = ("report", "metrics.json", "events.jsonl", ".digests.json", ".made", ".lock", ".exports.json", "blender")
"""What no stage and no export reads, or is made anew by itself."""


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "unveil_core", *map(str, words)]


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": "PASSIVE"}


def call(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*words), env=ENVIRONMENT, capture_output=True, text=True, check=False)


def contents(folder: Path) -> dict[str, str]:
    """Digests by name, without what holds times or follows from chance."""
    found = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = path.relative_to(folder).as_posix()
        if path.name not in LEFT_OUT and not name.startswith(OF_CHANCE):
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def killed(words: list[object], output: Path, times: int, generator: np.random.Generator) -> dict[str, Any]:
    """What is wrong after kills of a verb that writes to ``output``, each followed by the same call."""
    begun = time.monotonic()
    first = call(*words)
    seconds = time.monotonic() - begun
    assert first.returncode == 0, first.stderr
    whole, names = contents(output), sorted(p.name for p in output.parent.iterdir())
    wrong: Counter[str] = Counter()
    for turn in range(times):
        if turn % 2 == 0:
            shutil.rmtree(output)
        process = subprocess.Popen(
            command(*words), env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        time.sleep(float(generator.uniform(0.2, 1.0)) * seconds)
        process.send_signal(signal.SIGKILL)
        process.wait()
        again = call(*words)
        wrong["not ended well"] += again.returncode != 0
        now = contents(output)
        wrong["other files"] += now != whole
        other = [n for n in whole.keys() | now.keys() if whole.get(n) != now.get(n)]
        wrong["left behind"] += sorted(p.name for p in output.parent.iterdir()) != names
        print(words[0], turn, dict(wrong), other[:5], again.stderr[-200:] if again.returncode else "", flush=True)
    return {"kills": times, "seconds": round(seconds, 1), **{k: int(v) for k, v in wrong.items()}}


def damage(path: Path, how: str, generator: np.random.Generator) -> None:
    found, content = path.stat(), bytearray(path.read_bytes())
    if how == "half is gone":
        content = content[: len(content) // 2]
    elif how == "zeros":
        at = int(generator.integers(max(1, len(content) - 16)))
        content[at : at + 16] = bytes(len(content[at : at + 16]))
    else:
        content[int(generator.integers(len(content)))] ^= 1 << int(generator.integers(8))
    path.write_bytes(bytes(content))
    if how == "a bit, the time put back":
        os.utime(path, ns=(found.st_atime_ns, found.st_mtime_ns))


def flipped(ws: Path, times: int, generator: np.random.Generator, root: Path) -> dict[str, Any]:
    """Outcomes of changes of files of a finished workspace."""
    assert call("export", ws, "--to", FORMATS, "-o", root / "whole").returncode == 0
    whole = contents(root / "whole")
    files = [p for p in sorted(ws.rglob("*")) if p.is_file() and p.stat().st_size]
    kinds: dict[str, list[Path]] = {}
    for path in files:
        parts = path.relative_to(ws).parts
        kinds.setdefault("/".join((*parts[:2], path.suffix) if len(parts) > 2 else parts), []).append(path)
    outcomes: Counter[str] = Counter()
    silent: list[str] = []
    for turn in range(times):
        kind = list(kinds)[turn % len(kinds)]
        path = kinds[kind][int(generator.integers(len(kinds[kind])))]
        how = ("a bit", "a bit, the time put back", "half is gone", "zeros")[int(generator.integers(4))]
        before, times_before = path.read_bytes(), path.stat()
        damage(path, how, generator)
        name = path.relative_to(ws).as_posix()
        if path.read_bytes() == before:
            outcomes["nothing changed"] += 1
            continue
        status = call("status", ws, "--json")
        shutil.rmtree(root / "out", ignore_errors=True)
        out = call("export", ws, "--to", FORMATS, "-o", root / "out")
        lines = out.stderr.strip().splitlines()
        if out.returncode == 2 and lines and lines[-1].startswith("unveil: error: "):
            outcome = "told in one line"
        elif out.returncode == 0 and contents(root / "out") == whole:
            stale = status.returncode != 0 or '"stale"' in status.stdout or '"to do"' in status.stdout
            outcome = (
                "the export is whole" if stale or name.startswith(UNREAD) else "the export is whole, status says done"
            )
        elif out.returncode == 0:
            outcome = "SILENT: the export holds the damage"
        else:
            outcome = f"exit {out.returncode}"
        if outcome.startswith(("SILENT", "exit", "the export is whole, ")):
            silent.append(f"{name}: {how}: {outcome}")
            print(silent[-1], out.stderr[-200:], flush=True)
        outcomes[outcome] += 1
        path.write_bytes(before)
        os.utime(path, ns=(times_before.st_atime_ns, times_before.st_mtime_ns))
    return {"changes": times, "kinds": len(kinds), "outcomes": dict(outcomes), "to_look_at": silent}


def main() -> None:
    """Kill, flip, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, count in (("solve", 20), ("mask", 10), ("export", 20), ("flips", 210), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=count)
    arguments = parser.parse_args()
    generator = np.random.default_rng(arguments.seed)
    found: dict[str, Any] = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        street = root / "street"
        shutil.copytree(STREET, street, ignore=shutil.ignore_patterns("truth", "*.py"))
        document = json.loads((street / "transforms.json").read_text())
        document["frames"] = document["frames"][:4]
        (street / "transforms.json").write_text(json.dumps(document))
        if arguments.solve:
            drive = root / "s/drive"
            words = [
                "solve",
                CLIP / "clip.mp4",
                "-o",
                drive,
                "--frames",
                ":10",
                "--labels",
                CLIP / "labels",
                "--camera-height",
                "1.55",
            ]
            found["solve"] = killed(words, drive, arguments.solve, generator)
        if arguments.mask:
            masks = root / "m/masks"
            words = ["mask", street, "-o", masks, "--object", "car", "--click", "0:250,150"]
            found["mask"] = killed(words, masks, arguments.mask, generator)
        if arguments.export or arguments.flips:
            ws = root / "ws"
            assert call("run", street, "-o", ws, "--quality", "draft").returncode == 0
        if arguments.export:
            words = ["export", ws, "--to", FORMATS, "-o", root / "e/out"]
            found["export"] = killed(words, root / "e/out", arguments.export, generator)
        if arguments.flips:
            found["bits"] = flipped(ws, arguments.flips, generator, root)
    write_json_atomic(RESULTS, {**found, "machine": machine()})
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
