"""A batch on a Dask cluster: an existing one by its address, or one of local processes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.base.wording import about_as_much
from unveil_core.farm.manifest import Batch, Task
from unveil_core.farm.task import run_task, state_of
from unveil_core.forecast.machine import free_memory_mb

__all__ = ["MEMORY", "RETRIES", "run_batch", "workers_that_fit"]

RETRIES = 2
"""How often a failed task is tried again."""
PATIENCE = "20s"
"""How long a scheduler may take to answer."""
MEMORY = "unveil_mb"
"""Name of the resource by which workers of a cluster declare their memory, MB: ``dask worker --resources unveil_mb=8000``. No more
tasks than fit run on such a worker at a time."""
Teller = Callable[[str], None]


def run_batch(batch: Batch, tell: Teller, *, scheduler: str | None = None, workers: int = 2) -> list[str]:
    """Run all tasks that are not done, each when those before it are; returns the ids of those that failed for good.

    A task whose worker dies runs again on another one. What depends on a failed task is not run; the rest is.

    Args:
        tell: gets one line for each task that ended.
        scheduler: address of a running Dask scheduler, whose workers see the same files; None = a cluster of ``workers`` local
            processes, for this call only.
    Raises:
        SettingsError: Dask is not installed, no scheduler answers, or no worker has the memory that a task needs.
    """
    try:
        from distributed import Client, LocalCluster, as_completed
    except ImportError as error:
        raise SettingsError("batches need Dask", mend="pip install unveil-core[farm]") from error
    open_tasks = [t for t in batch.tasks if state_of(batch, t).status != "done"]
    tell(f"{len(batch.tasks)} tasks of {len(batch.drives)} drives, {len(batch.tasks) - len(open_tasks)} done already")
    if not open_tasks:
        return []
    with ExitStack() as stack:
        needs = {drive.name: drive.memory_mb for drive in batch.drives}
        if scheduler is None:
            count = workers_that_fit(workers, max(needs[t.drive] for t in open_tasks), tell)
            cluster = stack.enter_context(
                LocalCluster(n_workers=count, threads_per_worker=1, processes=True, dashboard_address=":0")
            )
            client = stack.enter_context(Client(cluster))
        else:
            try:
                client = stack.enter_context(Client(scheduler, timeout=PATIENCE))
            except (OSError, TimeoutError, ValueError) as error:
                raise SettingsError(
                    f"no Dask scheduler answers at {scheduler}", mend="start one, or use --workers"
                ) from error
        tell(f"dashboard: {client.dashboard_link}")
        room = _declared_memory(client)
        if room is not None and any(needs[t.drive] > room for t in open_tasks):
            short = sorted({t.drive for t in open_tasks if needs[t.drive] > room})
            raise SettingsError(
                f"no worker has the memory that {short[0]} needs, {needs[short[0]]} MB",
                mend=f"start workers with --resources {MEMORY}={needs[short[0]]}",
            )
        futures = _submitted(client, batch, open_tasks, needs if room is not None else None)
        return _watched(batch, as_completed(futures.values()), {f.key: t for t, f in futures.items()}, tell)


def workers_that_fit(wanted: int, memory_mb: int, tell: Teller) -> int:
    """How many workers of this machine have the memory that a task may need."""
    free = free_memory_mb()
    fitting = max(1, min(wanted, int(free // memory_mb))) if memory_mb else wanted
    if fitting < wanted:
        tell(f"workers: {fitting} instead of {wanted}, {about_as_much(memory_mb)} each; {about_as_much(free)} are free")
    return fitting


def _declared_memory(client: Any) -> float | None:
    """The most memory that a worker of the cluster declares; None where none does: then it is not minded."""
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    declared = [worker.get("resources", {}).get(MEMORY) for worker in workers]
    return max((d for d in declared if d is not None), default=None)


def _submitted(client: Any, batch: Batch, tasks: list[Task], needs: dict[str, int] | None) -> dict[Task, Any]:
    by_id: dict[str, Any] = {}
    futures: dict[Task, Any] = {}
    for task in tasks:
        before = [by_id[i] for i in task.after if i in by_id]
        future = client.submit(
            _run_after,
            str(batch.root.absolute()),
            task.id,
            before,
            key=f"{batch.root.name}-{task.id}",
            pure=False,
            retries=RETRIES,
            resources=None if needs is None else {MEMORY: needs[task.drive]},
        )
        by_id[task.id] = futures[task] = future
    return futures


def _run_after(root: str, task_id: str, before: list[dict[str, Any]]) -> dict[str, Any]:
    """Run a task on a worker; ``before``: results of those that it waited for."""
    return run_task(root, task_id)


def _watched(batch: Batch, ended: Any, task_of: dict[str, Task], tell: Teller) -> list[str]:
    """Tell what becomes of each task; returns the failed ones."""
    failed: list[str] = []
    for count, future in enumerate(ended, start=1):
        task = task_of[future.key]
        state = state_of(batch, task)
        where = f"{count}/{len(task_of)} {task.id}"
        if future.status == "finished":
            again = f", at try {state.tries}" if state.tries > 1 else ""
            tell(f"{where}: done in {state.seconds:.0f} s{again}")
            continue
        if state.status == "failed":
            failed.append(task.id)
            tell(f"{where}: failed after {state.tries} tries: {state.line}")
        elif future.status == "error" and not task.after:
            failed.append(task.id)
            tell(f"{where}: failed: {future.exception()}")
        else:
            tell(f"{where}: not run, what it depends on failed")
    return failed
