"""Checkouts of the program that are run as they are: a revision in a temporary git worktree, or a folder as it stands."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from unveil_core.base.files import write_json_atomic
from unveil_core.base.surroundings.programs import program
from unveil_core.bench.timing import program_commit

__all__ = ["LAST", "Run", "Tree", "checked_out", "environment_of", "run_once", "tree_at", "without"]

LAST = "deliver"
"""The stage that writes the frames, which are measured."""
DIGEST_LENGTH = 12
_DIGEST = f"""
import hashlib, sys
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.source_digest import code_digest
names, only = [s.name for s in STAGES], sys.argv[1:]
stages = [s for s in STAGES if s.name in only] if only else STAGES[: names.index({LAST!r}) + 1]
told = "".join(code_digest(s.run) for s in stages)
print(hashlib.blake2b(told.encode()).hexdigest()[:{DIGEST_LENGTH}])
"""


@dataclass(frozen=True)
class Tree:
    """A checkout.

    Attributes:
        root: its folder; name: what the tables call it: its commit, with a ``+`` where files differ from it.
        digest: of the code of all stages up to :data:`LAST`: what is not run in a run does not count.
        off: mechanisms that do not work, see ``RunSettings.without``.
    """

    root: Path
    name: str
    digest: str
    off: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """A run of a tree on a planted drive.

    Attributes:
        folder: with ``workspace/``; seconds: of all; load: of the machine when it began.
    """

    folder: Path
    seconds: float
    load: float

    @property
    def workspace(self) -> Path:
        """Of the run."""
        return self.folder / "workspace"


def tree_at(root: Path, stage: str | None = None) -> Tree:
    """The checkout in a folder, as it stands.

    Args:
        stage: whose code alone counts for the digest; None = all up to :data:`LAST`.
    Raises:
        SystemExit: it is no checkout of the program.
    """
    if not (root / "unveil_core" / "pipeline" / "graph.py").is_file():
        raise SystemExit(f"Not a checkout of Unveil: {root}. Name the folder that holds unveil_core.")
    told = subprocess.run(
        [sys.executable, "-c", _DIGEST, *([stage] if stage else [])],
        env=environment_of(root),
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    if told.returncode:
        raise SystemExit(f"{root} cannot be run: {told.stderr.strip().splitlines()[-1]}")
    return Tree(root.resolve(), program_commit(root) or root.resolve().name, told.stdout.strip())


def without(tree: Tree, names: Sequence[str]) -> Tree:
    """A checkout whose runs do without some mechanisms."""
    told = ",".join(names)
    return replace(tree, name=f"{tree.name} without {told}", digest=f"{tree.digest}_without_{told}", off=tuple(names))


@contextmanager
def checked_out(revision: str, repository: Path, stage: str | None = None) -> Iterator[Tree]:
    """A revision in a worktree of its own, which is gone afterwards; stage: see :func:`tree_at`.

    Raises:
        SystemExit: git does not know the revision.
    """
    git = [program("git") or "git", "-C", str(repository)]
    with tempfile.TemporaryDirectory(prefix="unveil-revision-") as temporary:
        root = Path(temporary) / "tree"
        made = subprocess.run(
            [*git, "worktree", "add", "--detach", str(root), revision], capture_output=True, text=True, check=False
        )
        if made.returncode:
            raise SystemExit(f"Not a revision: {revision}. {made.stderr.strip().splitlines()[-1]}")
        try:
            yield tree_at(root, stage)
        finally:
            subprocess.run([*git, "worktree", "remove", "--force", str(root)], capture_output=True, check=False)


def run_once(tree: Tree, drive: Path, runs: Path, quality: str, arguments: Sequence[str]) -> Run:
    """Run a tree on a drive, or take the run that the cache has of the same code, drive and quality. One without some mechanisms
    goes on from the run with all of them, for stages in which these do not work.

    Args:
        drive: folder of the planted drive; runs: folder for the runs on it, a folder for each.
        arguments: of ``unveil run``, besides drive, workspace and quality.
    Raises:
        RuntimeError: the run failed; its log stays beside the workspace.
    """
    folder = runs / run_key(tree.digest, quality)
    mark = folder / "run.json"
    if mark.is_file():
        told = json.loads(mark.read_text())
        return Run(folder, told["seconds"], told["load"])
    workspace = folder / "workspace"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    if tree.off:
        whole = replace(tree, digest=tree.digest.partition("_without_")[0], off=())
        begun = run_once(whole, drive, runs, quality, arguments).workspace
        shutil.copytree(begun, workspace, ignore=shutil.ignore_patterns(".lock"))
    command = [sys.executable, "-m", "unveil_core", "run", str(drive.resolve()), "-o", str(workspace.resolve())]
    command += ["--quality", quality, "--until", LAST, *arguments]
    command += [f"--without={','.join(tree.off)}"] if tree.off else []
    load, begun = round(os.getloadavg()[0], 2), time.perf_counter()
    with (folder / "run.log").open("w") as log:
        done = subprocess.run(
            command, env=environment_of(tree.root), cwd=tree.root, stdout=log, stderr=log, check=False
        )
    if done.returncode:
        last = (folder / "run.log").read_text().strip().splitlines()[-1:]
        raise RuntimeError(f"exit {done.returncode}: {''.join(last)[-300:]}")
    seconds = round(time.perf_counter() - begun, 1)
    row: dict[str, Any] = {"tree": tree.name, "digest": tree.digest, "quality": quality, "command": command[3:]}
    threads = {name: os.environ.get(name) for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS")}
    write_json_atomic(mark, {**row, "seconds": seconds, "load": load, "threads": threads})
    return Run(folder, seconds, load)


def run_key(digest: str, quality: str) -> str:
    """Name of the folder of a run: of what decides its result, besides the drive."""
    return f"{digest}_{quality}"


def environment_of(root: Path) -> dict[str, str]:
    """In which Python finds the package of a tree before all others."""
    return {**os.environ, "PYTHONPATH": str(root), "OMP_WAIT_POLICY": "PASSIVE", "PYTHONSAFEPATH": "1"}
