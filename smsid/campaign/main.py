"""A campaign from its plan to its summary, as the command line runs it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import cast

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from smsid.campaign.backends import Backend
from smsid.campaign.case import prepare
from smsid.campaign.plan import load_campaign
from smsid.campaign.run import Progress, run_campaign
from smsid.campaign.store import CampaignStore, read_store
from smsid.campaign.summary import Summary, save_summary, summarise


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
    console: Console | None = None,
) -> Summary:
    """Run a campaign into the store ``output``, or go on with it; write and return the summary.

    The summary goes beside the store, ``campaign.summary.json`` for ``campaign.jsonl``. ``runs`` overrides
    the plan's number; ``level`` is the family-wise level of the bands; progress is shown on ``console`` if
    given. ``dask_address`` implies the backend dask. The rest as `run_campaign`.

    Raises `ExperimentError` or `DescriptionError` for a plan that cannot be run, `SmsidError` for a store
    that cannot be used, `MissingDependencyError` without dask where it is asked for.
    """
    if dask_address is not None and backend == "loky":
        backend = "dask"
    campaign = load_campaign(plan_path)
    if runs is not None:
        campaign = campaign.with_runs(runs)
    prepared = prepare(campaign)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failures]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with (
        CampaignStore(output, prepared) as store,
        Bar(*columns, console=console, transient=True, disable=console is None) as bar,
    ):
        task = bar.add_task(campaign.name, total=campaign.runs, failures="")

        def show(state: Progress) -> None:
            failures = f"{state.failed} failed" if state.failed else ""
            bar.update(task, completed=state.done, failures=failures)

        run_campaign(
            prepared,
            store,
            backend=cast(Backend, backend),
            workers=workers,
            dask_address=dask_address,
            retry_failed=retry_failed,
            progress=show,
        )
    summary = summarise(read_store(output)[1], level=level)
    save_summary(summary, summary_path(output))
    return summary


def summary_path(output: str | os.PathLike[str]) -> Path:
    """Return where the summary of a store goes."""
    return Path(output).with_suffix(".summary.json")
