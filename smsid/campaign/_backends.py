"""Where runs are computed: this process, local worker processes, or a dask cluster."""

from __future__ import annotations

import logging
import os
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from functools import partial
from typing import Any, Literal

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from smsid.campaign.outcome import RunError, RunRecord
from smsid.errors import SmsidError, require

logger = logging.getLogger(__name__)

CONNECT_WITHIN = "15s"
WATCH = "smsid-campaign-watch"

Backend = Literal["loky", "dask", "serial"]
Task = Callable[[int], RunRecord]


def completed_runs(
    task: Task, runs: Iterable[int], workers: int, how: Mapping[str, Any]
) -> Generator[RunRecord]:
    """Yield the records of the runs as they finish, at most twice ``workers`` being under way.

    ``how`` goes to `joblib.parallel_config`.
    """
    options: dict[str, Any] = {
        "return_as": "generator_unordered",
        "batch_size": 1,
        "pre_dispatch": "2*n_jobs",
    }
    with joblib.parallel_config(n_jobs=workers, **how):
        results: Any = joblib.Parallel(**options)(joblib.delayed(task)(run) for run in runs)
    try:
        for record in results:  # noqa: UP028 - `yield from` would close it before the warning is caught
            yield record
    finally:
        with warnings.catch_warnings():  # joblib tells that runs under way are lost: known, and done again
            warnings.simplefilter("ignore", UserWarning)
            results.close()


def on_processes(task: Task, runs: Iterable[int], workers: int) -> Generator[RunRecord]:
    """Yield records from local worker processes, one BLAS thread each.

    When a worker dies (a segmentation fault, out of memory), the runs that were under way are done again one
    at a time, and the one that kills its worker again is recorded as failed.
    """
    how = {"backend": "loky", "inner_max_num_threads": 1}
    task = partial(_while_parent_lives, task, os.getpid())
    left = list(runs)
    while left:
        started: list[int] = []
        done: set[int] = set()
        try:
            with closing(completed_runs(task, _note_started(left, started), workers, how)) as results:
                for record in results:
                    done.add(record.run)
                    yield record
            return
        except TerminatedWorkerError as death:
            suspects = [run for run in started if run not in done]
            logger.warning("A worker died (%s); runs %s are done again, one at a time.", death, suspects)
        for run in suspects:
            yield _alone(task, run, how)
        left = [run for run in left if run not in done and run not in set(suspects)]


def _while_parent_lives(task: Task, parent: int, run: int) -> RunRecord:
    """Compute a run; in a worker, see to it that the worker ends when its parent is killed.

    Workers of loky would wait five minutes for more work, with all their memory.
    """
    if os.getpid() != parent and not any(t.name == WATCH for t in threading.enumerate()):
        threading.Thread(target=_end_with, args=(parent,), name=WATCH, daemon=True).start()
    return task(run)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _note_started(runs: Iterable[int], started: list[int]) -> Iterator[int]:
    for run in runs:
        started.append(run)
        yield run


def _alone(task: Task, run: int, how: dict[str, Any]) -> RunRecord:
    try:
        # with one worker joblib would compute it in this process
        return next(completed_runs(task, [run], 2, how))
    except TerminatedWorkerError:
        message = "The worker process died: a segmentation fault, or out of memory."
        return RunRecord(run=run, status="failed", error=RunError(type="WorkerDied", message=message))


def on_dask(task: Task, runs: Iterable[int], workers: int, address: str | None) -> Generator[RunRecord]:
    """Yield records from the dask cluster at ``address``, or from a local one of ``workers`` processes.

    Raises `MissingDependencyError` without dask, `SmsidError` when the cluster cannot be reached, has no
    workers, or lost a worker on the same run several times.
    """
    distributed = require("distributed", "campaign")
    with _client(distributed, workers, address) as client:
        try:
            yield from completed_runs(task, runs, -1, {"backend": "dask", "client": client})
        except (TimeoutError, distributed.KilledWorker) as cause:
            raise SmsidError(
                f"The dask cluster gave up: {cause}.",
                advice="Finished runs are stored. See that its workers have memory and can import smsid, "
                "then start the same campaign again.",
            ) from cause


@contextmanager
def _client(distributed: Any, workers: int, address: str | None) -> Iterator[Any]:
    if address is None:
        try:
            cluster = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
            )
        except RuntimeError as cause:
            raise SmsidError(
                f"The local dask cluster did not start: {cause}",
                advice="In a script, start the campaign under `if __name__ == '__main__':`.",
            ) from cause
        with cluster, distributed.Client(cluster, set_as_default=False) as client:
            yield client
        return
    try:
        client = distributed.Client(address, set_as_default=False, timeout=CONNECT_WITHIN)
    except (OSError, TimeoutError, ValueError) as cause:
        raise SmsidError(
            f"There is no dask scheduler at '{address}': {cause}.",
            advice="Start one with `dask scheduler`, and workers with `dask worker ADDRESS --nthreads 1`.",
            address=address,
        ) from cause
    with client:
        yield client
