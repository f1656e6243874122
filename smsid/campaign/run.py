"""Running a campaign: what is not in its store yet, on the backend asked for."""

from __future__ import annotations

import logging
import os
import re
import time
import traceback
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import cast, get_args

import joblib
from threadpoolctl import threadpool_limits

from smsid.campaign._backends import Backend, completed_runs, on_dask, on_processes
from smsid.campaign._case import PREFIX, PreparedCampaign, prepare
from smsid.campaign._methods import import_method
from smsid.campaign._plan import load_campaign
from smsid.campaign.outcome import Findings, RunError, RunRecord
from smsid.campaign.store import CampaignStore, read_store
from smsid.campaign.summary import Summary, save_summary, summarise
from smsid.errors import ExperimentError

logger = logging.getLogger(__name__)

MESSAGE_LENGTH = 2000
_TEMPORARY = re.compile(rf"[^\s'\"]*{PREFIX}[^/\\\s]*[/\\]")  # the folder of a case's files, new every time


@dataclass(frozen=True)
class Progress:
    """How far a campaign is: runs done (failures included) of ``total``, and failures among them."""

    done: int
    total: int
    failed: int


def run_campaign(
    prepared: PreparedCampaign,
    store: CampaignStore,
    *,
    backend: Backend = "loky",
    workers: int | None = None,
    dask_address: str | None = None,
    retry_failed: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> None:
    """Do the runs that the store lacks; each is stored as soon as it is finished.

    ``backend``: ``loky`` (worker processes of this machine), ``dask`` (the cluster at ``dask_address``, or a
    local one), ``serial`` (this process). ``workers``: how many processes, by default one per core; a cluster
    at ``dask_address`` has what it has. On a cluster of several machines, description, URDFs and plan must be
    at the same paths on all. ``retry_failed`` does runs again that ended in an error.

    An interruption at any moment loses only runs that are under way. A run that raises is stored with its
    error and the campaign goes on. Raises `SmsidError` when the store cannot be written or the cluster is out
    of reach, `ExperimentError` for a backend or number of workers that does not exist.
    """
    count = _worker_count(backend, workers, dask_address)
    runs = prepared.campaign.runs
    pending = store.pending_runs(runs, retry_failed=retry_failed)
    failed = {i for i in store.failed if i < runs} - set(pending)
    state = Progress(runs - len(pending), runs, len(failed))
    if progress is not None:
        progress(state)
    if not pending:
        return
    with closing(_results(partial(run_once, prepared), pending, backend, count, dask_address)) as results:
        for record in results:
            store.add(record)
            if not record.ok and record.error is not None:
                logger.info("Run %d failed: %s: %s", record.run, record.error.type, record.error.message)
            state = Progress(state.done + 1, runs, state.failed + (not record.ok))
            if progress is not None:
                progress(state)


def run_once(prepared: PreparedCampaign, run: int) -> RunRecord:
    """Return the record of one run: a pure function of campaign and index, but for ``seconds``.

    Whatever the method raises is in the record, an `ExperimentError` of the case too. BLAS is held to one
    thread: runs are what is parallel, and the number of threads would show in the last bit.
    """
    started = time.perf_counter()
    campaign = prepared.campaign
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            method = import_method(prepared.reference, campaign.folder)
            with prepared.case(run) as case:
                found = method(case, **campaign.options)
            if not isinstance(found, Findings):
                raise ExperimentError(
                    f"The method '{campaign.method}' returned {type(found).__name__}.",
                    advice="It must return smsid.campaign.Findings.",
                )
            record = RunRecord(run=run, status="ok", outcomes=found.outcomes, notes=found.notes)
        except Exception as error:  # a campaign goes on, whatever one run does
            record = RunRecord(run=run, status="failed", error=_error_record(error))
    return record.model_copy(update={"seconds": round(time.perf_counter() - started, 3)})


def _results(
    task: partial[RunRecord], runs: Sequence[int], backend: Backend, workers: int, address: str | None
) -> Generator[RunRecord]:
    if backend == "dask":
        return on_dask(task, runs, workers, address)
    if backend == "serial":
        return completed_runs(task, runs, 1, {"backend": "sequential"})
    return on_processes(task, runs, workers)


def _worker_count(backend: str, workers: int | None, address: str | None) -> int:
    if backend not in get_args(Backend):
        raise ExperimentError(
            f"There is no backend '{backend}'.", advice=f"Use {', '.join(get_args(Backend))}."
        )
    if address is not None and backend != "dask":
        raise ExperimentError(
            f"A dask address goes with the backend dask, not {backend}.", advice="Use --backend dask."
        )
    if workers is not None and workers < 1:
        raise ExperimentError(f"{workers} workers cannot do anything.", advice="Use 1 or more.")
    return workers or joblib.cpu_count()


def _error_record(error: Exception) -> RunError:
    """Return what to store of an error, without what differs from run to run of the same case."""
    message = _TEMPORARY.sub("", str(error))[:MESSAGE_LENGTH]
    frames = traceback.extract_tb(error.__traceback__)
    place = f"{Path(frames[-1].filename).name}, {frames[-1].name}" if frames else ""
    return RunError(type=type(error).__name__, message=message, place=place)


def campaign_main(
    plan_path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    backend: str = "loky",
    workers: int | None = None,
    dask_address: str | None = None,
    retry_failed: bool = False,
    runs: int | None = None,
    level: float = 0.01,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Run a campaign into the store ``output``, or go on with it; write and return the summary.

    The summary goes beside the store, ``campaign.summary.json`` for ``campaign.jsonl``. ``runs`` overrides
    the plan's number; ``level`` is the family-wise level of the bands. ``dask_address`` implies the backend
    dask. The rest as `run_campaign`.

    Raises `ExperimentError` or `DescriptionError` for a plan that cannot be run, `SmsidError` for a store
    that cannot be used, `MissingDependencyError` without dask where it is asked for.
    """
    if dask_address is not None and backend == "loky":
        backend = "dask"
    campaign = load_campaign(plan_path)
    if runs is not None:
        campaign = campaign.with_runs(runs)
    prepared = prepare(campaign)
    with CampaignStore(output, prepared) as store:
        run_campaign(
            prepared,
            store,
            backend=cast(Backend, backend),
            workers=workers,
            dask_address=dask_address,
            retry_failed=retry_failed,
            progress=progress,
        )
    summary = summarise(read_store(output)[1], level=level)
    save_summary(summary, summary_path(output))
    return summary


def summary_path(output: str | os.PathLike[str]) -> Path:
    """Return where the summary of a store goes."""
    return Path(output).with_suffix(".summary.json")
