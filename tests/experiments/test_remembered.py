"""What a search found is kept for the same spacecraft, and for no other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from smsid.description import load_description
from smsid.effects import JointFriction
from smsid.experiments import Experiment
from smsid.experiments import _named as named
from smsid.experiments.schema import StepProfile
from smsid.model import SpacecraftModel, build_model


class Search:
    """A search that counts how often it is run."""

    def __init__(self) -> None:
        self.runs = 0

    def __call__(self) -> Experiment:
        self.runs += 1
        force = StepProfile(times=(0.0,), values=((0.1 + 0.2, 1 / 3, 1e-300),))
        return Experiment(name="found", duration=2.0, force=force)


@pytest.fixture
def search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Search:
    monkeypatch.setenv(named.FOLDER, str(tmp_path / "kept"))
    return Search()


def craft(urdf: Path, **changed: object) -> SpacecraftModel:
    return build_model(load_description(urdf / "paper_sms.toml").model_copy(update=changed))


def test_the_same_spacecraft_gets_the_same_to_the_last_bit(urdf: Path, search: Search):
    first = named.load_or_search(craft(urdf), "exp2", search)
    assert named.load_or_search(craft(urdf), "exp2", search) == first == Search()()
    assert search.runs == 1


CHANGES: dict[str, Callable[[Path], tuple[SpacecraftModel, str]]] = {
    "name": lambda urdf: (craft(urdf), "exp2val"),
    "effect": lambda urdf: (
        build_model(
            load_description(urdf / "paper_sms.toml").with_effects(
                JointFriction(name="seal", joint="joint2", viscous=0.05)
            )
        ),
        "exp2",
    ),
    "urdf": lambda urdf: (heavier(urdf), "exp2"),
}


def heavier(urdf: Path) -> SpacecraftModel:
    model = craft(urdf)
    model.pin.inertias[1].mass *= 1 + 1e-12
    return model


@pytest.mark.parametrize("what", CHANGES)
def test_what_differs_is_searched_anew(urdf: Path, search: Search, what: str):
    named.load_or_search(craft(urdf), "exp2", search)
    named.load_or_search(*CHANGES[what](urdf), search)
    assert search.runs == 2


def test_other_code_searches_anew(urdf: Path, search: Search, monkeypatch: pytest.MonkeyPatch):
    named.load_or_search(craft(urdf), "exp2", search)
    monkeypatch.setattr(named, "_code", lambda: "another")
    named.load_or_search(craft(urdf), "exp2", search)
    assert search.runs == 2


@pytest.mark.parametrize("spoilt", ["", "{", '{"name": "found"}'])
def test_a_file_that_is_not_whole_is_replaced(urdf: Path, search: Search, tmp_path: Path, spoilt: str):
    found = named.load_or_search(craft(urdf), "exp2", search)
    (file,) = (tmp_path / "kept" / "experiments").iterdir()
    file.write_text(spoilt)
    for _ in range(2):
        assert named.load_or_search(craft(urdf), "exp2", search) == found
    assert search.runs == 2


@pytest.mark.parametrize("where", ["a file is there", "no cache wanted"])
def test_where_nothing_can_be_kept_it_is_found_all_the_same(
    urdf: Path, search: Search, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(named.FOLDER, str(tmp_path / "file") if where == "a file is there" else "")
    for _ in range(2):
        assert named.load_or_search(craft(urdf), "exp2", search).name == "found"
    assert search.runs == 2
