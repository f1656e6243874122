"""Stamps that count from an epoch: the same numbers as from zero, and times by the recording's own clock."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import smsid
from smsid.description import Description, load_description
from smsid.diagnose import diagnose
from smsid.diagnose._extended_description import as_now
from smsid.effects import ActuatorDelay, ExternalWrench, MassLoss, StuckChannel
from smsid.estimation.arm_motion import identify_arm_motion
from smsid.estimation.clock_shift import clock_shift, on_shifted_clock
from smsid.estimation.flight import flight_of
from smsid.estimation.hidden_states import hidden_states
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.joint_problem import on_one_clock
from smsid.estimation.parameter_vector import Point
from smsid.recording import Recording
from smsid.sensing.component import ComponentError
from smsid.sensing.error_model import ErrorModel
from tests.hidden.catalogue import hidden_effects
from tests.hidden.flight import write_run
from tests.tracking.craft import craft, flight

EPOCH = 1_700_000_000.25  # [s] in November 2023


def arm(folder, hidden: str, value: float, onset: float | None = None) -> tuple[Description, list[Recording]]:
    """MuJoCo's arm, that hides something, and two recordings of it with stamps since 1970."""
    change = hidden_effects("arm")[hidden].make(value, onset, np.random.default_rng(5))
    files = write_run("arm", folder, [1, 79], [change], duration=30.0)
    own = [smsid.load_recording(path) for path in (files.recording, files.validation)]
    return load_description(files.description), [r.shifted(EPOCH) for r in own]


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    return arm(tmp_path_factory.mktemp("late"), "actuator_delay:delay@joint2", 0.02)


def test_only_stamps_since_an_epoch_are_shifted():
    short = flight(3.0)
    assert clock_shift([short]) == 0.0
    assert clock_shift([short.shifted(1000.0)]) == 0.0
    assert clock_shift([short.shifted(2e5)]) == 0.0  # a mission's clock
    assert clock_shift([short.shifted(EPOCH)]) == -1_700_000_000.0
    assert clock_shift([short.shifted(EPOCH), short.shifted(EPOCH - 50.0)]) == -1_699_999_950.0
    assert clock_shift([short, short.shifted(EPOCH)]) == 0.0


def test_recordings_that_follow_one_another_since_an_epoch_keep_their_distance():
    first, second = flight(3.0).shifted(EPOCH), flight(3.0, seed=2).shifted(EPOCH + 100.0)
    a, b = on_one_clock([first, second], ["a", "b"])
    assert a.shift == b.shift == -1_700_000_000.0
    assert a.recording.time()[0] == 0.25
    assert b.recording.time()[0] == 100.25


def test_a_recording_since_an_epoch_is_placed_after_one_from_zero():
    own = [flight(3.0), flight(3.0, seed=2).shifted(EPOCH), flight(3.0, seed=3).shifted(2e5)]
    for order in ((0, 1), (1, 0), (1, 2)):
        a, b = on_one_clock([own[i] for i in order], ["a", "b"])
        gap = b.recording.time()[0] - a.recording.time()[-1]
        assert a.recording.time()[0] < 1.0 and gap == pytest.approx(0.1, abs=1e-6)
    a, b = on_one_clock([own[0], own[2]], ["a", "b"])  # two days apart
    assert (a.shift, b.shift) == (0.0, 0.0)


def test_what_grows_and_errors_of_sensors_go_with_the_clock(tmp_path):
    leak = MassLoss(name="leak", rate=1e-4, position=(0.5, 0.0, 0.0))  # since 0 s
    described = craft(tmp_path).with_effects(leak)
    errors = ErrorModel(
        noise_sigma=1e-5,
        stuck_from=4.0,
        bias=1e-3,
        bias_from=2.0,
        components={"0": ComponentError(stuck_from=3.0)},
    )
    sensor = described.sensor[1].model_copy(update={"errors": {"angular_rate": errors}})
    described = described.model_copy(update={"sensor": (described.sensor[0], sensor)})
    shifted = on_shifted_clock(described, -100.0)
    assert shifted.get_effect("leak").start == -100.0
    found = shifted.sensor[1].errors["angular_rate"]
    assert (found.stuck_from, found.bias_from, found.components["0"].stuck_from) == (-96.0, -98.0, -97.0)
    back = on_shifted_clock(shifted, 100.0)
    assert back.get_effect("leak").start == 0.0
    assert back.sensor[1].errors["angular_rate"] == errors


@pytest.mark.parametrize("epoch", [0.0, 1_700_000_000.0])
def test_a_fit_of_two_recordings_stands_in_the_second_by_its_own_clock(tmp_path, epoch):
    """Recordings of 0 to 50 s each, one after the other: the second is 51 s later there than by its own."""
    push = ExternalWrench(name="push", torque=(0.1, 0.0, 0.0), start=70.0)
    early = ExternalWrench(name="early", force=(0.1, 0.0, 0.0), start=20.0)
    leak = MassLoss(name="leak", rate=1e-4, position=(0.5, 0.0, 0.0))  # since the first began
    point: Any = Point.of(craft(tmp_path).with_effects(push, early, leak))
    parts = tuple(
        SimpleNamespace(first=k, shift=s - epoch, label=n) for k, s, n in ((0, 0.0, "a"), (1, 51.0, "b"))
    )
    problem = SimpleNamespace(parts=parts, shift=-epoch, data=SimpleNamespace(times=np.array([0.0, 51.0])))
    found: Any = SimpleNamespace(point=point, problem=problem)
    effects = as_now(found).description
    assert effects.get_effect("push").start == epoch + 19.0
    assert effects.get_effect("early").start is None  # long ago
    assert effects.get_effect("leak").start == epoch - 51.0  # what is gone by then is gone


def test_a_stuck_reading_is_left_out_from_its_time_on(tmp_path):
    for shift in (0.0, EPOCH):
        stuck = StuckChannel(name="stuck", sensor="gyro", quantity="angular_rate", start=4.0 + shift)
        point = Point.of(craft(tmp_path).with_effects(stuck))
        recording = flight(8.0).shifted(shift)
        own = clock_shift([recording])
        description = on_shifted_clock(point.description, own)
        made = flight_of(replace(point, description=description), recording, "x", shift=own)
        data = made.problem.data
        (rows,) = [b.rows for b in data.blocks if b.channel == "gyro.angular_rate"]
        assert np.isfinite(data.values[:, rows]).all(axis=1).sum() == 40
        assert len(data.times) == 81  # rounded stamps are no longer steps


def test_effects_begin_later_by_a_clock_that_shows_more(tmp_path):
    push = ExternalWrench(name="push", torque=(0.1, 0.0, 0.0), start=20.0)
    always = ExternalWrench(name="drag", force=(0.1, 0.0, 0.0))
    described = craft(tmp_path).with_effects(push, always)
    shifted = on_shifted_clock(described, 5.0)
    assert shifted.get_effect("push").start == 25.0
    assert shifted.get_effect("drag").start is None
    assert on_shifted_clock(described, 0.0) is described


def test_a_delay_is_identified(late):
    described, (recording, _) = late
    described = described.with_effects(ActuatorDelay(name="late", actuator="joint2", delay=5e-3))
    found = identify_arm_motion(described, [recording], reason="a test")
    delay = found.estimate["late.delay"]
    assert delay.status == "identifiable" and delay.sigma < 2e-6
    assert delay.value == pytest.approx(0.02, abs=4.0 * delay.sigma)
    assert found.quality is not None and found.quality.judgement == "explained"


def test_a_delay_is_diagnosed(late):
    described, (recording, validation) = late
    found = diagnose(described, [recording], validation=[validation])
    assert found.diagnosis.verdict == "explained"
    (cause,) = found.diagnosis.causes
    assert (cause.effect, cause.location) == ("actuator_delay", "joint2")
    value = cause.parameters[0]
    assert value.value == pytest.approx(0.02, abs=4.0 * value.sigma) and value.sigma < 2e-6
    assert found.diagnosis.gain is not None
    assert found.diagnosis.gain.whitened_extended < 1.1


def test_what_begins_midway_is_told_by_the_clock_of_the_recording(tmp_path):
    described, (recording, validation) = arm(tmp_path, "joint_friction:viscous@joint2", 0.5, onset=12.0)
    found = diagnose(described, [recording], validation=[validation])
    (cause,) = found.diagnosis.causes
    assert found.diagnosis.verdict == "explained" and cause.effect == "joint_friction"
    assert cause.onset == pytest.approx(EPOCH + 12.0, abs=0.5)
    assert f"{cause.onset:.2f}"[:10] in found.diagnosis.sentence
    (added,) = [e for e in found.extended.effect if e.kind == "joint_friction"]
    assert added.start == pytest.approx(EPOCH + 12.0, abs=0.5)
    again = diagnose(found.extended, [recording])
    assert again.diagnosis.verdict == "adequate"


def test_flights_are_identified_as_from_zero(tmp_path):
    described = craft(tmp_path)
    push = ExternalWrench(name="push", torque=(0.01, 0.0, 0.0), start=8.0, known=("force",))
    recording = flight(20.0)
    plain = identify_flights(described.with_effects(push), [recording])
    later = push.model_copy(update={"start": 8.0 + EPOCH})
    found = identify_flights(described.with_effects(later), [recording.shifted(EPOCH)])
    assert found.description.get_effect("push").start == 8.0 + EPOCH
    for p, q in zip(plain.estimate.parameters, found.estimate.parameters, strict=True):
        assert q.value == pytest.approx(p.value, abs=0.2 * p.sigma)  # stamps are rounded to 0.24 us
        assert q.sigma == pytest.approx(p.sigma, rel=0.02)
    told = hidden_states(found, parameters=False)
    assert told.time(told.channels[0])[0] == pytest.approx(EPOCH, abs=1e-6)
