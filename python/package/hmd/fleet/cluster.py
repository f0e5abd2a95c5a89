"""The contract on a Dask cluster: this computer's cores, or any scheduler's workers that see the same folders."""

import contextlib
import itertools
import logging
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from .contract import Job, Outcome, one_log

BATCH = 8
"""Logs of a task: enough that the scheduler is idle, few enough that nobody waits long for the last one."""

AHEAD = 4
"""Tasks that run or wait for each worker; the others are not made yet, so memory does not grow with the folder."""

AHEAD_LEAST = 64
"""The same for all workers together."""

RESTART_S = 30
"""Longest wait for workers that are being started again, s, before the cluster is closed."""


def assess_all(
    logs: list[Path], job: Job, *, scheduler: str | None, workers: int, each: Callable[[Outcome], None]
) -> None:
    """Assesses logs on a cluster, showing each outcome as it comes.

    A task whose worker dies goes to another one; where that happens four times, its logs go one by one, and one that
    kills its workers again is an outcome without a key. No worker at all is this process, without Dask.
    """
    if scheduler is None and workers == 0:
        for log in logs:
            each(one_log(log, job))
        return
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise SystemExit("hmd.fleet: expected Dask (pip install 'ema-hmd[dask]'), found none") from error

    if scheduler is not None:
        try:
            client = Client(scheduler)
        except OSError as error:
            raise SystemExit(f"hmd.fleet: {scheduler}: expected a Dask scheduler, found none: {error}") from error
        with client:
            _run(client, logs, job, each)
        return
    options = {"n_workers": workers, "threads_per_worker": 1, "processes": True, "host": "127.0.0.1"}
    # A worker has one task at a time, so that one which kills its worker is not mixed up with those that wait there.
    # Nor does it look a hundred times a second where it is.
    settings = {"distributed.scheduler.worker-saturation": 1.0, "distributed.worker.profile.enabled": False}
    nanny = logging.getLogger("distributed.nanny")
    level = nanny.level
    try:
        with (
            dask.config.set(settings),
            LocalCluster(**options, dashboard_address="127.0.0.1:0") as cluster,
            Client(cluster) as client,
        ):
            _run(client, logs, job, each)
            # While a killed worker is being started again, closing the cluster fails in some versions of Dask.
            with contextlib.suppress(TimeoutError):
                client.wait_for_workers(workers, timeout=RESTART_S)
            # All is done; a worker that a busy computer does not let end within seconds is killed, which is no failure.
            nanny.setLevel(logging.ERROR)
    finally:
        nanny.setLevel(level)


def batch(logs: list[str], job: Job) -> list[Outcome]:
    """What a task does, on a worker."""
    return [one_log(Path(log), job) for log in logs]


def _run(client: Any, logs: list[Path], job: Job, each: Callable[[Outcome], None]) -> None:
    from distributed import KilledWorker, as_completed

    def submit(names: list[str]) -> Any:
        # Pure: the same logs twice at the same time would be one task.
        future = client.submit(batch, names, job, pure=False)
        of[future.key] = names
        return future

    of: dict[str, list[str]] = {}
    waiting: Iterator[list[str]] = (
        [str(log) for log in logs[first : first + BATCH]] for first in range(0, len(logs), BATCH)
    )
    # Workers may join later.
    ahead = max(AHEAD_LEAST, AHEAD * len(client.scheduler_info(n_workers=-1)["workers"]))
    running = as_completed([submit(names) for names in itertools.islice(waiting, ahead)])
    for future in running:
        names = of.pop(future.key)
        error = future.exception()
        if error is None:
            for outcome in future.result():
                each(outcome)
        elif not isinstance(error, KilledWorker):
            raise error
        elif len(names) == 1:
            print(f"hmd.fleet: {names[0]}: its worker died each time", file=sys.stderr)
            each(Outcome(names[0], message="its worker died each time"))
        else:
            waiting = itertools.chain([[name] for name in names], waiting)
        # One out, one in; after a batch was taken apart, as many as there is room for.
        for names in itertools.islice(waiting, max(1, ahead - len(of))):
            running.add(submit(names))
