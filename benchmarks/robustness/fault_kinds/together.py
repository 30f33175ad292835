"""Several runs in one workspace, and file systems that cannot keep them apart."""

from __future__ import annotations

import errno
import re
import shutil
import time
from collections.abc import Iterator

from benchmarks.robustness.fault_kinds.bench import Bench
from benchmarks.robustness.fault_kinds.drives import preloaded, shim
from benchmarks.robustness.fault_kinds.runs import Ended, Run, Tally, digests, done, stage_now

UNTIL = ("--until", "segment")
"""What runs that are started together come to: they meet at the start."""
HOLDER = re.compile(r"In use by another process, (\d+) on ")


def together(bench: Bench, count: int, times: int, *, half: bool = False) -> Tally:
    """Runs that are started within 50 ms of each other.

    Args:
        half: in a workspace where a run was killed; else in a folder that is not there yet.
    """
    where = "a workspace half finished" if half else "a new folder"
    tally = Tally(f"{count} runs within 50 ms in {where}", "one finishes, each other: 2, one line that names it")
    plain = bench.new()
    bench.start(plain, *UNTIL).wait()
    wanted = digests(plain)
    for _ in range(times):
        workspace = bench.new()
        finished = set[str]()
        if half:
            run = bench.start(workspace, *UNTIL)
            while stage_now(workspace) != "objects" and not done(workspace) >= {"segment"}:
                time.sleep(0.01)
            run.send(9)
            run.wait()
            finished = done(workspace)
        gaps = [0.0, *sorted(bench.generator.uniform(0, 0.05, count - 1))]
        begun, runs = time.monotonic(), list[Run]()
        for gap in gaps:
            time.sleep(max(0.0, begun + gap - time.monotonic()))
            runs.append(bench.start(workspace, *UNTIL))
        ends = [run.wait() for run in runs]
        _judge(bench, tally, runs, [e for e in ends if e is not None], finished)
        tally.times += 1
        tally.compare(digests(workspace), wanted)
        shutil.rmtree(workspace, ignore_errors=True)
    return tally


def _judge(bench: Bench, tally: Tally, runs: list[Run], ends: list[Ended], finished: set[str]) -> None:
    numbers = {str(run.pid) for run in runs}
    winners = [e for e in ends if not e.code]
    for ended in ends:
        tally.codes[str(ended.code)] = tally.codes.get(str(ended.code), 0) + 1
    if len(winners) != 1:
        tally.wrong += 1
        tally.trouble.append(f"{len(winners)} of {len(ends)} finished: {[e.lines for e in ends]}")
    for ended in winners:
        bench.count_lost(tally, ended, finished)
    for ended in (e for e in ends if e.code):
        named = [found[1] for line in ended.lines if (found := HOLDER.search(line))]
        if len(ended.lines) != 1 or ended.has_traceback or len(named) != 1 or named[0] not in numbers:
            tally.unclear += 1
            tally.trouble.append(ended.text[-1000:])


def no_locks(bench: Bench, times: int) -> Iterator[Tally]:
    """A file system whose locks fail, as of some network file systems."""
    library = shim(bench)
    for name, variables in (("", {}), (", UNVEIL_NO_LOCKS=1", {"UNVEIL_NO_LOCKS": "1"})):
        tally = Tally(f"file system without locks{name}", "0" if name else "2, one line")
        if library is None:
            tally.skipped = "no gcc"
        errors = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)[: 1 if name else times]
        for number in errors if library else ():
            workspace = bench.new()
            code, text = preloaded(bench, library, workspace, *UNTIL, UNVEIL_FLOCK_ERROR=str(number), **variables)
            ended = Ended(code, text)
            tally.note(ended, lines=0 if name else 1, hide=(workspace,))
            tally.wrong += code != (0 if name else 2)
            shutil.rmtree(workspace, ignore_errors=True)
        yield tally
