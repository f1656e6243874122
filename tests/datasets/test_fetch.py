"""Data sets are found locally, verified, and refused by name."""

from __future__ import annotations

import gzip
import sys

import pytest

from smsid.datasets import DATASETS, DataFile, DataSet, data_set, fetch, have, sha256
from smsid.errors import MissingDependencyError, RecordingError

ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # of b"abc", FIPS 180-2


@pytest.fixture
def small(tmp_path, monkeypatch):
    chosen = DataSet("small", "a test", "owner/name", "0123abcd", "MIT", (DataFile("a.csv", ABC),))
    monkeypatch.setattr(sys.modules["smsid.datasets._fetch"], "DATASETS", {"small": chosen})
    monkeypatch.setenv("SMSID_DATA", str(tmp_path))
    (tmp_path / "small").mkdir()
    return tmp_path / "small"


def test_the_sum_is_that_of_the_content_packed_or_not(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    (tmp_path / "a.gz").write_bytes(gzip.compress(b"abc"))
    assert sha256(tmp_path / "a") == sha256(tmp_path / "a.gz") == ABC


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz"])
def test_local_copies_are_found(small, name):
    assert not have("small")
    (small / name).write_bytes(gzip.compress(b"abc") if name.endswith("gz") else b"abc")
    assert have("small")
    assert fetch("small", download=False) == {"a.csv": small / name}


def test_another_content_is_refused_with_both_sums(small):
    (small / "a.csv").write_bytes(b"abd")
    with pytest.raises(RecordingError, match=f"not the published file.*{ABC}"):
        fetch("small")


def test_a_damaged_gzip_is_named(small):
    (small / "a.csv.gz").write_bytes(gzip.compress(b"abc" * 100)[:-9])
    with pytest.raises(RecordingError, match=r"a\.csv\.gz is damaged"):
        fetch("small")


def test_absence_says_where_it_comes_from(small):
    with pytest.raises(RecordingError, match=r"absent.*SMSID_DATA.*owner/name at commit 0123abcd \(MIT\)"):
        fetch("small", download=False)


def test_a_file_of_unknown_place_is_not_guessed(small):
    with pytest.raises(RecordingError, match="where it lies in its repository is unknown"):
        fetch("small")


def test_downloading_needs_the_extra(small, monkeypatch):
    known = DataSet("small", "", "owner/name", "0", "MIT", (DataFile("a.csv", ABC, "data/a.csv"),))
    monkeypatch.setattr(sys.modules["smsid.datasets._fetch"], "DATASETS", {"small": known})
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[data\]"):
        fetch("small")


def test_unknown_data_sets_get_the_closest_name():
    with pytest.raises(RecordingError, match="Did you mean 'silverbox'"):
        fetch("silverbx")


@pytest.mark.parametrize("name", sorted(DATASETS))
def test_the_registry_is_complete(name):
    chosen = data_set(name)
    assert chosen.licence and "/" in chosen.repository and len(chosen.commit) >= 7 and chosen.files
    for file in chosen.files:
        assert len(bytes.fromhex(file.sha256)) == 32
    assert len({file.sha256 for file in chosen.files}) == len(chosen.files)


@pytest.mark.parametrize("name", sorted(DATASETS))
def test_local_copies_are_the_published_files(name):
    if not have(name):
        pytest.skip(f"SMSID_DATA has no copy of {name}")
    assert set(fetch(name, download=False)) == {file.name for file in DATASETS[name].files}
