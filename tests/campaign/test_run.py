"""Running: the same results on every backend, failures recorded, workers that die."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from smsid.campaign import (
    CampaignStore,
    campaign_main,
    load_campaign,
    prepare,
    read_store,
    run_campaign,
    run_once,
)
from smsid.campaign.run import Progress
from smsid.errors import ExperimentError, MissingDependencyError, SmsidError

from campaign.conftest import lines_of  # isort: skip

Plan = Callable[..., Path]


def serial(plan: Path, runs: range) -> dict[int, str]:
    """What every backend must give."""
    prepared = prepare(load_campaign(plan))
    out = {}
    for run in runs:
        record = json.loads(run_once(prepared, run).model_dump_json())
        record.pop("seconds")
        out[run] = json.dumps(record)
    return out


def test_results_depend_on_neither_order_nor_workers(make_plan: Plan, tmp_path: Path) -> None:
    plan = make_plan()
    expected = serial(plan, range(12))
    for name, how in {
        "serial": {"backend": "serial"},
        "two": {"workers": 2},
        "three": {"workers": 3},
    }.items():
        campaign_main(plan, tmp_path / f"{name}.jsonl", **how)
        assert lines_of(tmp_path / f"{name}.jsonl") == expected
    assert serial(plan, range(11, -1, -1)) == expected


@pytest.fixture
def dask_plan(make_plan: Plan) -> Path:
    pytest.importorskip("distributed", reason="dask is not installed (extra: campaign)")
    return make_plan(options={"trace": True, "pause": 0.05}, runs=16)


def test_a_local_dask_cluster_of_two_processes_gives_the_same(dask_plan: Path, tmp_path: Path) -> None:
    campaign_main(dask_plan, tmp_path / "dask.jsonl", backend="dask", workers=2)
    assert len(list(tmp_path.glob("pid_*"))) == 2
    assert lines_of(tmp_path / "dask.jsonl") == serial(dask_plan, range(16))


def test_a_dask_cluster_by_address_goes_on_with_a_store_of_this_machine(
    dask_plan: Path, tmp_path: Path
) -> None:
    import distributed

    store = tmp_path / "both.jsonl"
    campaign_main(dask_plan, store, backend="serial", runs=5)
    for file in tmp_path.glob("pid_*"):
        file.unlink()
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        campaign_main(dask_plan, store, dask_address=cluster.scheduler_address)
    assert len(list(tmp_path.glob("pid_*"))) == 2
    assert lines_of(store) == serial(dask_plan, range(16))


def test_a_scheduler_that_is_not_there_is_told(
    make_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="dask is not installed (extra: campaign)")
    monkeypatch.setattr("smsid.campaign._backends.CONNECT_WITHIN", "1s")
    with pytest.raises(SmsidError, match=r"no dask scheduler at 'tcp://127\.0\.0\.1:9'"):
        campaign_main(make_plan(), tmp_path / "c.jsonl", dask_address="tcp://127.0.0.1:9")


def test_without_dask_the_pip_line_is_told(
    make_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[campaign\]"):
        campaign_main(make_plan(), tmp_path / "c.jsonl", backend="dask")


def test_failing_runs_are_recorded_and_retried_on_request(make_plan: Plan, tmp_path: Path) -> None:
    plan, store = make_plan(options={"failing": [2, 5]}), tmp_path / "c.jsonl"
    summary = campaign_main(plan, store, workers=2)
    assert (summary.runs, summary.failed, summary["mass"].runs) == (12, 2, 10)
    assert [(f.type, f.count, f.run) for f in summary.failures] == [("ValueError", 2, 2)]
    error = next(r.error for r in read_store(store)[1] if r.run == 5)
    assert error is not None
    assert (error.type, error.message) == ("ValueError", "run 5 was told to fail")
    assert error.place == "cheap_method.py, measure"

    (tmp_path / "mended").touch()
    before = store.read_bytes()
    assert campaign_main(plan, store, backend="serial").failed == 2
    assert store.read_bytes() == before
    summary = campaign_main(plan, store, backend="serial", retry_failed=True)
    assert (summary.runs, summary.failed, summary["mass"].runs) == (12, 0, 12)
    assert store.read_bytes().startswith(before)


def test_a_run_that_kills_its_worker_is_recorded_and_the_rest_is_done(
    make_plan: Plan, tmp_path: Path
) -> None:
    plan, store = make_plan(options={"deadly": [4]}), tmp_path / "c.jsonl"
    summary = campaign_main(plan, store, workers=2)
    assert [(f.type, f.count, f.run) for f in summary.failures] == [("WorkerDied", 1, 4)]
    assert sorted(lines_of(store)) == list(range(12))
    others = {k: v for k, v in lines_of(store).items() if k != 4}
    assert others == {k: v for k, v in serial(plan, range(4)).items()} | {
        k: v for k, v in serial(plan, range(5, 12)).items()
    }


def test_messages_do_not_name_files_that_exist_only_while_the_run_lasts(make_plan: Plan) -> None:
    """They differ from time to time, and a run must not."""
    method = "cheap_method:refuse"
    plan = make_plan(method=method, truth=[{"links": ["bus"], "relative": 0.1}])
    prepared = prepare(load_campaign(plan))
    errors = [run_once(prepared, run).error for run in (0, 0)]
    assert errors[0] == errors[1]
    assert errors[0] is not None
    assert errors[0].message == "'truth/0_paper_sms.urdf' is refused"


def test_a_method_that_returns_no_findings_is_told(make_plan: Plan, tmp_path: Path) -> None:
    summary = campaign_main(
        make_plan(method="cheap_method:wrong", runs=1), tmp_path / "c.jsonl", backend="serial"
    )
    assert "must return smsid.campaign.Findings" in summary.failures[0].message


def test_progress_counts_what_was_there(make_plan: Plan, tmp_path: Path) -> None:
    plan, store = make_plan(options={"failing": [1]}), tmp_path / "c.jsonl"
    campaign_main(plan, store, backend="serial", runs=5)
    seen: list[Progress] = []
    prepared = prepare(load_campaign(plan))
    with CampaignStore(store, prepared) as opened:
        run_campaign(prepared, opened, backend="serial", retry_failed=True, progress=seen.append)
    assert seen[0] == Progress(4, 12, 0)
    assert seen[-1] == Progress(12, 12, 1)


def test_an_interruption_keeps_what_is_finished(make_plan: Plan, tmp_path: Path) -> None:
    plan, store = make_plan(), tmp_path / "c.jsonl"
    prepared = prepare(load_campaign(plan))

    def interrupt(state: Progress) -> None:
        if state.done == 5:
            raise KeyboardInterrupt

    with CampaignStore(store, prepared) as opened, pytest.raises(KeyboardInterrupt):
        run_campaign(prepared, opened, workers=2, progress=interrupt)
    assert len(lines_of(store)) == 5
    campaign_main(plan, store, workers=2)
    assert lines_of(store) == serial(plan, range(12))


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"backend": "threads"}, "no backend 'threads'"),
        ({"workers": 0}, "0 workers"),
        ({"backend": "serial", "dask_address": "tcp://127.0.0.1:1"}, "goes with the backend dask"),
        ({"runs": 0}, "0 runs"),
        ({"level": 2.0, "backend": "serial"}, "level"),
    ],
)
def test_bad_arguments_are_refused(make_plan: Plan, tmp_path: Path, how: dict, words: str) -> None:
    with pytest.raises(ExperimentError, match=words):
        campaign_main(make_plan(), tmp_path / "c.jsonl", **how)
