"""Causes are told in words, every kind of them."""

from __future__ import annotations

import pytest

from smsid.diagnose import Alias, Diagnosis, FoundCause, Value
from smsid.effects import Effect, catalogue
from smsid.report.diagnosis_tables import cause_in_words, plain_words
from smsid.report.numbers import with_half


def cause(effect="joint_friction", location="joint2", shape: str | None = "viscous", **more):
    value = Value(f"{effect}_{location}.viscous", 1.5, 0.001, "N m s/rad")
    return FoundCause(effect, location, "friction", shape, (value,), (), {}, **more)


def test_a_cause_is_a_sentence_with_its_interval():
    d = Diagnosis("craft", ("rec",), "explained", "It lacks friction.", causes=(cause(),))
    unit = "N m s/rad".replace(" ", "\N{NO-BREAK SPACE}")
    wanted = (
        f"In plain words: joint2 has viscous friction that the description lacks, 1.5000 ± 0.0020 {unit}."
    )
    assert plain_words(d) == wanted
    assert plain_words(Diagnosis("craft", ("rec",), "adequate", "Nothing.")) == ""


def test_what_is_not_told_apart_is_said():
    alias = Alias("joint_friction", "joint2", "friction", "coulomb", 0.99, "move at several rates")
    told = cause_in_words(
        FoundCause("joint_friction", "joint2", "friction", None, (), (alias,), {}, onset=30.0)
    )
    assert "joint2 has friction" in told and "from 30 s on" in told and "coulomb at joint2" in told


def test_a_kind_without_words_of_its_own_is_told_by_its_summary(monkeypatch):
    cable = catalogue()["joint_cable"]
    monkeypatch.setattr(cable, "in_words", Effect.in_words)
    told = cause_in_words(cause("joint_cable", "joint2", None))
    assert told.startswith(f"joint2 has an effect that the description lacks ({cable.summary})")


@pytest.mark.parametrize("kind", sorted(catalogue()))
def test_every_kind_of_the_catalogue_has_words(kind):
    assert catalogue()[kind].in_words != Effect.in_words
    told = cause_in_words(cause(kind, "place", "shape"))
    assert "place" in told or kind.startswith("thruster")
    assert "{" not in told and "_" not in told.partition(",")[0]


@pytest.mark.parametrize(
    ("value", "half", "told"),
    [(1.50003, 4.4e-4, "1.50003 ± 0.00044"), (-3.25, 0.5, "−3.25 ± 0.50"), (2221.0, 12.3, "2221 ± 12"),
     (1e-9, 2e-10, "1·10⁻⁹ ± 2·10⁻¹⁰")],
)  # fmt: skip
def test_a_value_and_its_interval_end_at_the_same_decimal(value, half, told):
    assert with_half(value, half) == told
