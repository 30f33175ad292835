"""A batch on a Dask cluster: an existing one by its address, or this machine."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.base.wording import about_as_long, about_as_much
from unveil_core.farm.dashboard import LOOPBACK, guard, local_dashboard, new_prefix
from unveil_core.farm.manifest import Batch, BatchDrive, Task
from unveil_core.farm.state import TaskState, note_state, state_of
from unveil_core.farm.task import end_tasks, run_task, tasks_may_begin
from unveil_core.forecast.machine import free_memory_mb

__all__ = ["GPU", "MEMORY", "RETRIES", "run_batch", "workers_that_fit"]

RETRIES = 2
"""How often a failed task is tried again."""
PATIENCE = "20s"
"""How long a scheduler may take to answer."""
MEMORY, GPU = "unveil_mb", "unveil_gpu"
"""Names of the resources by which workers of a cluster declare their memory, MB, and their GPUs:
``dask worker --resources "unveil_mb=8000 unveil_gpu=1"``. No more tasks than fit run on such a worker at a time."""
BEGUN = "unveil-begun"
"""Topic under which workers tell what they begin."""
Teller = Callable[[str], None]


def run_batch(batch: Batch, tell: Teller, *, scheduler: str | None = None, workers: int = 2) -> list[str]:
    """Run all tasks that are not done, each when those before it are; returns the ids of those that failed for good.

    A task whose worker dies runs again on another one. What depends on a failed task is not run; the rest is.

    Args:
        tell: gets one line for each task that begins or ends.
        scheduler: address of a running Dask scheduler, whose workers see the same files; None = ``workers`` tasks at a time on this
            machine, for this call only.
    Raises:
        SettingsError: Dask is not installed, no scheduler answers, or no worker has the memory or the GPU that a task needs.
    """
    try:
        from distributed import as_completed
    except ImportError as error:
        raise SettingsError("batches need Dask", mend="pip install distributed bokeh") from error
    open_tasks = [t for t in batch.tasks if state_of(batch, t).status != "done"]
    tell(f"{len(batch.tasks)} tasks of {len(batch.drives)} drives, {len(batch.tasks) - len(open_tasks)} done already")
    if not open_tasks:
        return []
    waiting = {task.drive for task in open_tasks}
    drives = [drive for drive in batch.drives if drive.name in waiting]
    with _client(_root(batch), scheduler, workers, drives, tell) as (client, dashboard):
        tell(f"dashboard: {dashboard}")
        needs = {drive.name: _asked(client, drive, tell) for drive in drives}
        client.subscribe_topic(BEGUN, lambda event: tell(f"{event[1]['task']}: begun on {event[1]['where']}"))
        futures = _submitted(client, batch, open_tasks, needs)
        return _watched(batch, as_completed(futures.values()), futures, tell)


@contextmanager
def _client(
    root: str, scheduler: str | None, workers: int, drives: list[BatchDrive], tell: Teller
) -> Iterator[tuple[Any, str | None]]:
    """A client of the cluster at an address, or of workers in this process; and the address of its dashboard."""
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        if scheduler is not None:
            try:
                client = stack.enter_context(Client(scheduler, timeout=PATIENCE))
            except (OSError, TimeoutError, ValueError) as error:
                mend = "start one, or use --workers"
                raise SettingsError(f"no Dask scheduler answers at {scheduler}", mend=mend) from error
            yield client, client.dashboard_link
            return
        gpus = max(drive.gpus for drive in drives)
        if gpus and workers > 1:
            tell("workers: 1, for the tasks use the GPU")
        count = 1 if gpus else workers_that_fit(workers, max(drive.memory_mb for drive in drives), tell)
        # Workers are threads, for each task is a process of its own: so there is no port at which another user of this machine
        # could run code. The dashboard only shows what is done.
        prefix = new_prefix()
        cluster = LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=False,
            dashboard_address=f"{LOOPBACK}:0",
            worker_dashboard_address=f"{LOOPBACK}:0",
            scheduler_kwargs={"http_prefix": prefix},
            resources={GPU: gpus} if gpus else None,
            silence_logs=logging.CRITICAL,  # what a task says is told by this module
        )
        stack.callback(tasks_may_begin, root)
        client = stack.enter_context(Client(stack.enter_context(cluster)))
        guard(cluster, prefix)
        stack.callback(end_tasks, root)  # first of the three: the cluster waits for its threads
        yield client, local_dashboard(client, prefix)


def _root(batch: Batch) -> str:
    """By which tasks know their batch."""
    return str(batch.root.absolute())


def workers_that_fit(wanted: int, memory_mb: int, tell: Teller) -> int:
    """How many workers of this machine have the memory that a task may need; one at least."""
    free = free_memory_mb()
    fitting = max(1, min(wanted, int(free // memory_mb))) if memory_mb else wanted
    if fitting < wanted:
        tell(f"workers: {fitting} instead of {wanted}, {about_as_much(memory_mb)} each; {about_as_much(free)} are free")
    elif memory_mb > free:
        tell(f"a task may need {about_as_much(memory_mb)}, of which {about_as_much(free)} are free: it may be stopped")
    return fitting


def _asked(client: Any, drive: BatchDrive, tell: Teller) -> dict[str, float]:
    """The resources that each task of a drive asks for.

    Raises:
        SettingsError: no worker has them.
    """
    asked: dict[str, float] = {}
    room = _declared(client, MEMORY)
    if room is not None and drive.memory_mb:
        if drive.memory_mb > room:
            raise SettingsError(
                f"no worker has the memory that {drive.name} needs, {drive.memory_mb} MB",
                mend=f"start workers with --resources {MEMORY}={drive.memory_mb}",
            )
        asked[MEMORY] = drive.memory_mb
    if drive.gpus:
        if (_declared(client, GPU) or 0) < drive.gpus:
            raise SettingsError(
                f"no worker has the GPU that {drive.name} needs", mend=f"start workers with --resources {GPU}=1"
            )
        asked[GPU] = drive.gpus
    return asked


def _declared(client: Any, resource: str) -> float | None:
    """The most of a resource that a worker of the cluster declares; None where none does: then it is not minded."""
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    declared = [worker.get("resources", {}).get(resource) for worker in workers]
    return max((d for d in declared if d is not None), default=None)


def _submitted(client: Any, batch: Batch, tasks: list[Task], needs: dict[str, dict[str, float]]) -> dict[str, Any]:
    """The futures by the tasks' ids."""
    futures: dict[str, Any] = {}
    for task in tasks:
        futures[task.id] = client.submit(
            _run_after,
            _root(batch),
            task.id,
            [futures[i] for i in task.after if i in futures],
            key=f"{batch.root.name}-{task.id}",
            pure=False,
            retries=RETRIES,
            resources=needs[task.drive] or None,
        )
    return futures


def _run_after(root: str, task_id: str, before: list[dict[str, Any]]) -> dict[str, Any]:
    """Run a task on a worker; ``before``: results of those that it waited for."""
    from distributed import get_worker

    worker = get_worker()
    where = f"worker {worker.name}" if worker.address.startswith("inproc:") else worker.address
    worker.log_event(BEGUN, {"task": task_id, "where": where})  # Dask itself notes the address as "worker"
    return run_task(root, task_id)


def _watched(batch: Batch, ended: Any, futures: dict[str, Any], tell: Teller) -> list[str]:
    """Tell what becomes of each task; returns the failed ones."""
    failed: list[str] = []
    by_key = {futures[t.id].key: t for t in batch.tasks if t.id in futures}
    clock = _Clock(batch, list(by_key.values()))
    for count, future in enumerate(ended, start=1):
        task = by_key[future.key]
        state = state_of(batch, task)
        where = f"{count}/{len(by_key)} {task.id}"
        clock.end(task)
        if future.status == "finished":
            again = f", at try {state.tries}" if state.tries > 1 else ""
            tell(f"{where}: done in {state.seconds:.0f} s{again}{clock.left()}")
            continue
        # A task that ended well may be asked for again, for its result died with its worker: pending, not failed.
        if any(i in futures and futures[i].status in ("error", "cancelled") for i in task.after):
            tell(f"{where}: not run, what it depends on failed")
            continue
        failed.append(task.id)
        if state.status != "failed":  # its last worker could not say so
            state = TaskState("failed", state.tries, state.seconds, f"its worker died: {future.exception()}")
            note_state(batch, task, state)
        tell(f"{where}: failed after {state.tries} tries: {state.line}")
    return failed


class _Clock:
    """How long the rest of the tasks will take, from what those that ended took and what all were expected to."""

    def __init__(self, batch: Batch, tasks: list[Task]) -> None:
        shares = {d.name: d.seconds / max(1, sum(t.drive == d.name for t in batch.tasks)) for d in batch.drives}
        self.expected = {task.id: shares[task.drive] for task in tasks}
        self.begun, self.over = time.monotonic(), 0.0

    def end(self, task: Task) -> None:
        self.over += self.expected.pop(task.id)

    def left(self) -> str:
        rest = sum(self.expected.values())
        if not self.over or not rest:
            return ""
        return f", {about_as_long((time.monotonic() - self.begun) * rest / self.over)} left"
