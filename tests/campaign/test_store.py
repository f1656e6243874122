"""The store: torn lines, other campaigns, runs counted once, full disks."""

from __future__ import annotations

import errno
import logging
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from smsid.campaign import CampaignStore, Outcome, RunError, RunRecord, load_campaign, prepare, read_store
from smsid.campaign._case import PreparedCampaign
from smsid.errors import SmsidError


@pytest.fixture
def prepared(make_plan: Callable[..., Path]) -> PreparedCampaign:
    return prepare(load_campaign(make_plan()))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "campaign.jsonl"


def good(run: int, value: float = 0.1) -> RunRecord:
    return RunRecord(run=run, status="ok", outcomes=(Outcome(name="x", value=value),))


def bad(run: int) -> RunRecord:
    return RunRecord(run=run, status="failed", error=RunError(type="ValueError", message="no"))


def fill(path: Path, prepared: PreparedCampaign, *records: RunRecord) -> None:
    with CampaignStore(path, prepared) as store:
        for record in records:
            store.add(record)


def test_numbers_survive_to_the_last_bit(path: Path, prepared: PreparedCampaign) -> None:
    record = RunRecord(
        run=0,
        status="ok",
        outcomes=(
            Outcome(name="a", value=0.1 + 0.2, sigma=5e-324, truth=-0.0, interval=(-1e308, 1 / 3)),
            Outcome(name="b", value=float("inf"), sigma=float("inf"), truth=None),
        ),
    )
    fill(path, prepared, record)
    assert list(read_store(path)[1]) == [record]
    nan = good(1, float("nan"))
    assert RunRecord.model_validate_json(nan.model_dump_json()).model_dump_json() == nan.model_dump_json()
    assert "NaN" not in nan.model_dump_json().replace('"NaN"', "")


def test_every_way_to_tear_the_last_line_is_mended(path: Path, prepared: PreparedCampaign) -> None:
    fill(path, prepared, good(0), good(1))
    whole = path.read_bytes()
    start = whole.rindex(b"\n", 0, -1) + 1
    for cut in range(start, len(whole)):
        path.write_bytes(whole[:cut])
        assert [r.run for r in read_store(path)[1]] == [0]
        with CampaignStore(path, prepared) as store:
            assert store.pending_runs(3) == [1, 2]
            store.add(good(1))
        assert path.read_bytes() == whole


def test_a_last_line_of_zeros_is_torn_too(path: Path, prepared: PreparedCampaign) -> None:
    """File systems leave them after a power cut."""
    fill(path, prepared, good(0))
    whole = path.read_bytes()
    path.write_bytes(whole + b"\0" * 50)
    fill(path, prepared)
    assert path.read_bytes() == whole
    path.write_bytes(whole + b"\0" * 50 + b"\n")
    fill(path, prepared)
    assert path.read_bytes() == whole


def test_a_header_torn_while_it_was_written_is_written_again(path: Path, prepared: PreparedCampaign) -> None:
    fill(path, prepared)
    header = path.read_bytes()
    for cut in (0, 1, len(header) // 2, len(header) - 1):
        path.write_bytes(header[:cut])
        fill(path, prepared)
        assert path.read_bytes() == header


def test_a_damaged_line_in_the_middle_is_refused(path: Path, prepared: PreparedCampaign) -> None:
    fill(path, prepared, good(0), good(1), good(2))
    lines = path.read_bytes().splitlines(keepends=True)
    lines[2] = b'{"run": 1, "sta\n'
    path.write_bytes(b"".join(lines))
    before = path.read_bytes()
    with pytest.raises(SmsidError, match=r"Line 3 .* is damaged"):
        CampaignStore(path, prepared)
    assert path.read_bytes() == before


def test_files_that_are_no_store_are_refused_and_left_alone(path: Path, prepared: PreparedCampaign) -> None:
    for content in (b"my notes\nof today", b'{"kind": "estimate"}\n', b"\x00\x01", b"\n\n"):
        path.write_bytes(content)
        with pytest.raises(SmsidError, match="no store"):
            CampaignStore(path, prepared)
        assert path.read_bytes() == content
    with pytest.raises(SmsidError, match="Cannot write"):
        CampaignStore(path.parent / "none" / "x.jsonl", prepared)
    with pytest.raises(SmsidError, match="Cannot write"):
        CampaignStore(path.parent, prepared)
    with pytest.raises(SmsidError, match="does not exist"):
        read_store(path.parent / "none.jsonl")


@pytest.mark.parametrize(
    ("keys", "changed"),
    [
        ({"seed": 8}, ["seed"]),
        ({"truth": []}, ["truth"]),
        ({"name": "b", "options": {"pause": 0.1}}, ["name", "options"]),
    ],
)
def test_another_campaign_is_refused(
    keys: dict, changed: list[str], path: Path, prepared: PreparedCampaign, make_plan: Callable[..., Path]
) -> None:
    fill(path, prepared, good(0))
    before = path.read_bytes()
    with pytest.raises(SmsidError, match="different campaign") as caught:
        CampaignStore(path, prepare(load_campaign(make_plan(**keys))))
    assert caught.value.evidence["changed"] == changed
    assert path.read_bytes() == before


@pytest.mark.parametrize("file", ["paper_sms.toml", "paper_sms.urdf"])
def test_a_changed_input_is_another_campaign(
    file: str, path: Path, prepared: PreparedCampaign, tmp_path: Path
) -> None:
    fill(path, prepared)
    with (tmp_path / file).open("a") as stream:
        stream.write("\n")
    with pytest.raises(SmsidError, match=r"urdf|paper_sms"):
        CampaignStore(path, prepare(prepared.campaign))


def test_more_runs_and_another_note_are_the_same_campaign(
    path: Path, prepared: PreparedCampaign, make_plan: Callable[..., Path]
) -> None:
    fill(path, prepared, good(0))
    more = prepare(load_campaign(make_plan(runs=99, note="continued")))
    with CampaignStore(path, more) as store:
        assert len(store.pending_runs(99)) == 98


def test_other_versions_are_told(
    path: Path, prepared: PreparedCampaign, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    fill(path, prepared)
    monkeypatch.setattr("smsid.campaign.store.__version__", "9.9")
    with caplog.at_level(logging.WARNING):
        fill(path, prepared)
    assert "not 9.9: runs may differ" in caplog.text


def test_no_run_is_counted_twice(path: Path, prepared: PreparedCampaign) -> None:
    fill(path, prepared, good(0, 1.0), bad(1))
    with CampaignStore(path, prepared) as store:
        assert not store.add(good(0, 2.0))
        assert store.failed == (1,)
        assert store.pending_runs(3) == [2]
        assert store.pending_runs(3, retry_failed=True) == [1, 2]
        store.add(good(1))
        assert store.failed == () and store.pending_runs(2) == []
    content = path.read_bytes()
    path.write_bytes(
        content + good(0, 3.0).model_dump_json().encode() + b"\n" + bad(1).model_dump_json().encode() + b"\n"
    )
    records = {r.run: r for r in read_store(path)[1]}
    assert records == {0: good(0, 1.0), 1: good(1)}


def test_two_processes_cannot_write_one_store(path: Path, prepared: PreparedCampaign) -> None:
    pytest.importorskip("fcntl", reason="no file locks on this system")
    with CampaignStore(path, prepared), pytest.raises(SmsidError, match="another process"):
        CampaignStore(path, prepared)
    fill(path, prepared)


def test_a_full_disk_costs_no_result(
    path: Path, prepared: PreparedCampaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    with CampaignStore(path, prepared) as store:
        store.add(good(0))
        before = path.read_bytes()
        real = os.write

        def full(file: int, data: bytes) -> int:
            if len(data) < 20:
                raise OSError(errno.ENOSPC, "No space left on device")
            return real(file, bytes(data)[: len(data) // 2])

        with monkeypatch.context() as patch:
            patch.setattr(os, "write", full)
            with pytest.raises(SmsidError, match="No space left"):
                store.add(good(1))
        assert path.read_bytes() == before
        store.add(good(1))
    assert [r.run for r in read_store(path)[1]] == [0, 1]
