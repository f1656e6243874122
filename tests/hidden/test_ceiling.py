"""What the experiments allow, against what these numbers mean."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from . import ceiling
from .catalogue import hidden_effects
from .ceiling import Signals, chance, held_out, open_loop, recognised, same
from .fisher import FLAT
from .judge import Injected

LEVEL, MANY = 0.003, 100


def catalogue(correlations: np.ndarray) -> Signals:
    """Effects of strength 1, all signed, with given correlations."""
    base = hidden_effects("arm")["torque_gain:error@joint1"]
    effects = [replace(base, location=f"joint{i}", signed=True) for i in range(len(correlations))]
    return Signals(tuple(effects), 5.4**2 * correlations)


def rate(known: Signals, strength: float = 1.0) -> float:
    """How often the first effect is recognised."""
    drawn = [Injected(known.effects[0], 1.0, strength)] * 4000
    return recognised(known, drawn, MANY, LEVEL, np.random.default_rng(0))


def test_one_that_is_like_no_other_is_recognised_with_the_power_of_its_test():
    power = norm.sf(norm.isf(0.5 * LEVEL / MANY) - 5.4)
    assert rate(catalogue(np.eye(1))) == pytest.approx(power, abs=0.02)


def test_one_with_a_sign_is_found_more_often():
    known = catalogue(np.eye(1))
    bound = Signals((replace(known.effects[0], signed=False),), known.gram)
    power = norm.sf(norm.isf(0.5 * LEVEL / MANY) - 5.4)
    assert rate(bound) == pytest.approx(norm.sf(norm.isf(LEVEL / MANY) - 5.4), abs=0.02)
    assert rate(bound) > power + 0.01


@pytest.mark.parametrize(("others", "expected"), [(2, 1.0), (3, 0.75), (5, 0.5)])
def test_of_several_that_are_all_alike_any_three_are_as_good(others: int, expected: float):
    """Far above the limit, with a correlation of nearly one: the truth is among three by chance."""
    n = others + 1
    known = catalogue(np.eye(n) + (1.0 - 1e-12) * (np.ones((n, n)) - np.eye(n)))
    assert rate(known, strength=3.0) == pytest.approx(expected, abs=0.03)


def test_naming_one_of_two_that_say_the_same_is_naming_the_other():
    arm = hidden_effects("arm")
    viscous, coulomb = (arm[f"joint_friction:{x}@joint1"] for x in ("viscous", "coulomb"))
    other = replace(viscous, kind="drag", shapes=())
    assert not same(viscous, other)
    assert same(viscous, replace(other, others=("joint_friction",)))
    assert not same(viscous, replace(other, others=("joint_friction",), location="joint2"))
    assert same(viscous, viscous)
    assert not same(viscous, coulomb)
    assert not same(viscous, arm["joint_friction:viscous@joint2"])


@pytest.mark.parametrize(("eigenvalue", "most"), [(0.0, 1e-9), (100.0, 67.4)])
def test_chance_of_what_an_estimate_costs(eigenvalue: float, most: float):
    """Nothing unknown costs nothing; one large unknown costs its square, plus what noise makes of it."""
    rng = np.random.default_rng(0)
    z, noise = rng.standard_normal((2, 100_000)) * np.sqrt(eigenvalue), rng.standard_normal(100_000)
    expected = float(np.mean((z[0] + noise) ** 2 - noise**2 <= most))
    assert chance(np.array([eigenvalue]), most, rng, draws=20000) == pytest.approx(expected, abs=0.01)


class Flight:
    """Five seconds to settle and a hundred more at 1 Hz of a position and a gain that acts on it throughout;
    of three more channels of zeros in one; and a start that stays what it is.
    """

    def __init__(self, size: float):
        time = np.arange(106.0)
        self.commands = SimpleNamespace(time=time)
        self.nominal = {"pose.position": np.zeros((106, 1)), "imu.angular_rate": np.zeros((106, 3))}
        columns = np.zeros((4 * 106, 2))
        columns[:106] = np.array([size * time, np.ones(106)]).T
        self.nuisances = lambda: (columns, np.array([1.0, FLAT]))


@pytest.mark.parametrize("first", [0.0, 0.01])  # of which the second leaves a tenth
def test_a_simulation_errs_by_what_the_first_flight_left_unknown(monkeypatch, first):
    """By hand: the start is a mean of six samples, the gain as uncertain as a regression leaves it."""
    monkeypatch.setattr(ceiling, "experiment", lambda world, number: Flight((0.2, first)[number == 0]))
    ratios = open_loop("any", np.random.default_rng(1), settle=5.0, draws=4000)
    time = np.arange(106.0)
    unknown = 1.0 / (1.0 + first**2 * np.sum((time - time.mean()) ** 2))
    later = time[6:]
    own = 0.2**2 * unknown * np.mean((later - time[:6].mean()) ** 2)
    noise = 2.0 + 1.0 / 6.0  # of both channels, and the mean's
    assert np.mean(ratios**2) == pytest.approx(1.0 + own / noise, rel=0.1)


@pytest.mark.slow
def test_what_stays_unknown_costs_on_the_held_out_flight_what_the_tool_says_too(tmp_path):
    """The filter's own derivatives and covariance predict the same excess as simulations of the world."""
    from smsid.diagnose.diagnose import RATE
    from smsid.diagnose.validation import read_like
    from smsid.estimation.map_estimate import evaluate
    from smsid.recording import load_recording

    from .flight import write_run
    from .study import diagnosed

    files = write_run("arm", tmp_path, [60017, 79])
    found, _ = diagnosed(files, tmp_path)
    last = found.search.last
    _, problem = read_like(last.point, load_recording(files.validation), last.problem, RATE)
    w = evaluate(last.point, last.unknowns, problem).whitened.reshape(-1, len(last.unknowns))
    own = float(np.sum((w @ np.linalg.inv(last.gram)) * w))
    assert held_out("arm").sum() == pytest.approx(own, rel=0.15)
