"""Whole designs: better than the paper's excitation, within limits as simulated, repeatable."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.design import Limits, design_experiment
from smsid.errors import ExperimentError
from smsid.experiments import fly, load_experiment, save_experiment
from smsid.likelihood import fisher_information

SHORT = {"duration": 20.0, "effort": 0.03}


@pytest.fixture(scope="module")
def thrust(description):
    return design_experiment(
        description, ["tank.damping.x"], duration=30.0, limits=Limits(stroke=0.15), name="short"
    )


def test_thrust_is_predicted_as_the_bound_says(description, thrust):
    """The bound by its own public function; before and after."""
    for experiment, sigma in ((thrust.experiment, thrust.sigma), (thrust.reference, thrust.before)):
        expected = fisher_information(description, experiment).sigma["tank.damping.x"]
        assert sigma[0] == pytest.approx(expected, rel=1e-6)
    assert thrust.gain > 1.5
    assert thrust.relative[0] == pytest.approx(thrust.sigma[0] / 0.02)


def test_thrust_flies_within_its_limits(model, thrust, tmp_path):
    save_experiment(thrust.experiment, tmp_path / "e.toml")
    again = load_experiment(tmp_path / "e.toml")
    flight = fly(model, again, np.random.default_rng(0))
    uses = {u.quantity: u.value for u in flight.limits}
    assert 0.14 < uses["stroke of tank"] < 0.15
    assert uses["thrust per axis"] < 60.0
    assert not flight.exceeded
    assert again.hold_attitude and again.name == "short"


def test_the_reference_uses_its_limits_too(model, thrust):
    """The paper's thrust is scaled until something is used up, though joints stand within their ranges."""
    uses = {u.quantity: u.value for u in fly(model, thrust.reference, np.random.default_rng(0)).limits}
    assert 0.14 < uses["stroke of tank"] < 0.15


def test_only_the_axis_that_matters_fires(thrust):
    assert not np.any(np.array(thrust.experiment.force.values)[:, 1:])


def test_the_seed_gives_it_back(description, thrust):
    again = design_experiment(
        description, ["tank.damping.x"], duration=30.0, limits=Limits(stroke=0.15), name="short"
    )
    assert again.experiment == thrust.experiment
    np.testing.assert_array_equal(again.sigma, thrust.sigma)


@pytest.fixture(scope="module")
def motion(description):
    limits = Limits(pointing=0.05, stroke=0.02)
    return design_experiment(description, ["inertia"], limits=limits, seed=3, **SHORT)


def test_motion_flies_within_its_limits(model, motion):
    flight = fly(model, motion.experiment, np.random.default_rng(0))
    assert not flight.exceeded
    uses = {u.quantity: u.value for u in flight.limits}
    assert uses["stroke of tank"] < 0.02
    attitude = flight.recording["pose.attitude"]
    turn = 2.0 * np.arccos(np.clip(np.abs(attitude @ attitude[0]), 0.0, 1.0)).max()
    assert turn < 0.05 + 1e-3  # 1e-4 rad of noise
    shares = [Limits(pointing=0.05, stroke=0.02).share(u) for u in motion.limits]
    assert max(shares) <= 1.0 + 1e-6


def test_motion_shows_what_was_asked_for(motion):
    assert any(n.startswith("bus.Izz") for n in motion.goal.names)
    assert not any("tank" in n for n in motion.goal.names)
    assert np.isfinite(motion.relative).all()


def stopping(after: int):
    def progress(stage: str, tried: int, best: float) -> None:
        if tried >= after:
            raise KeyboardInterrupt

    return progress


def test_interrupts_keep_the_best(description):
    found = design_experiment(
        description, ["tank.damping.x"], duration=20.0, limits=Limits(stroke=0.1), progress=stopping(3)
    )
    assert found.interrupted and found.evaluations == 3
    assert "interrupted" in found.notes[0]
    assert found.sigma[0] > 0.0


def test_limits_that_no_motion_keeps_are_named(description):
    with pytest.raises(ExperimentError, match="No motion keeps these limits: turn of the bus") as caught:
        design_experiment(description, ["inertia"], limits=Limits(pointing=1e-9), **SHORT)
    assert caught.value.evidence["limits"]


def test_a_precision_out_of_reach_is_told(description):
    with pytest.raises(ExperimentError, match=r"out of reach within 15 s.*held back by.*stroke of tank"):
        design_experiment(
            description, ["tank.damping.x"], to=0.001, duration=15.0, limits=Limits(stroke=0.05)
        )


def test_thrust_without_limit_is_told(description):
    free = description.model_copy(
        update={"thrust": description.thrust.model_copy(update={"max_force": None})}
    )
    with pytest.raises(ExperimentError, match="states no limit of its thrust"):
        design_experiment(free, ["slosh"], duration=15.0)


@pytest.mark.parametrize(
    ("wanted", "options", "message"),
    [
        ([], {}, "Nothing is asked for"),
        (["slosh"], {"criterion": "E"}, "no criterion 'E'"),
        (["slosh"], {"duration": -1.0}, "duration of -1.0 s"),
        (["slosh"], {"to": 0.0}, "precision of 0.0"),
        (["slosh"], {"axes": "xw"}, "letters of 'xyz'"),
        (["nothing"], {}, "nothing 'nothing' to be found out"),
        (["inertia"], {"mode": "thrust"}, "nothing moves that would show them"),
    ],
)
def test_bad_questions_are_told(description, wanted, options, message):
    with pytest.raises(ExperimentError, match=message):
        design_experiment(description, wanted, **options)
