"""The test's own Fisher information: projection, limits against closed forms and drawn worlds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from . import fisher
from .catalogue import hidden_effects, nameable_effects
from .experiment import RATE
from .fisher import DETECTION, Experiment, Named, distance_after
from .flight import fly
from .limits import strength_one, table
from .numbers import WORLDS, moved, nominal
from .sensors import NOISE, measured


@given(st.integers(0, 2**32 - 1), st.floats(-2.0, 3.0))
@settings(max_examples=30, deadline=None)
def test_projection_is_that_of_the_marginal_covariance(seed, scale):
    """|P v|^2 = v^T (1 + J S^2 J^T)^-1 v, and so for products: nuisances integrated out with their priors."""
    rng = np.random.default_rng(seed)
    jacobian, sigma = 10**scale * rng.standard_normal((40, 5)), rng.uniform(0.3, 3.0, 5)
    q = fisher._shrunk(jacobian, sigma)
    a, b = rng.standard_normal((2, 40))
    precision = np.linalg.inv(np.eye(40) + (jacobian * sigma**2) @ jacobian.T)
    pa, pb = (v - q @ fisher._root(q, v) for v in (a, b))
    assert pa @ pb == pytest.approx(a @ precision @ b, abs=1e-6)
    assert pa @ pa == pytest.approx(a @ precision @ a, abs=1e-6)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """The arm for 8 s, its cache apart."""
    patch = pytest.MonkeyPatch()
    patch.setattr(fisher, "CACHE", tmp_path_factory.mktemp("cache"))
    yield Experiment("arm", 0, 8.0)
    patch.undo()


def test_limit_of_a_bias_is_never_below_that_of_its_mean(short):
    """Without nuisances a bias has sigma / sqrt(N); what the initial state explains can only raise it."""
    found = short.limit("sensor_bias:bias@encoder.joint_velocity[joint2]")
    least = DETECTION * NOISE["encoder.joint_velocity"] / np.sqrt(8.0 * RATE + 1)
    assert 1.0 <= found.value / least < 3.0
    assert found.raw == pytest.approx(DETECTION * found.value / least, rel=1e-6)


def test_limit_does_not_depend_on_where_the_search_starts(short):
    import dataclasses

    effect = hidden_effects("arm")["torque_gain:error@joint2"]
    values = [
        short._search(dataclasses.replace(effect, guess=factor * effect.guess)).value
        for factor in (0.1, 1, 10)
    ]
    np.testing.assert_allclose(values, values[0], rtol=0.03)


def test_limits_are_kept(short):
    name = "joint_friction:viscous@joint2"
    first = short.limit(name)
    again = Experiment("arm", 0, 8.0)
    again._search = lambda effect: pytest.fail("searched again")  # type: ignore[method-assign]
    assert again.limit(name) == first


def test_matched_filter_sees_the_stated_distance_in_drawn_worlds(short):
    """Worlds with noise and other nominal numbers: the filter's output has the distance as its mean, and the
    spread that noise alone gives it, so that strength 1 is what it says.
    """
    name = "torque_gain:error@joint2"
    effect, value = hidden_effects("arm")[name], short.limit(name).value
    signal = short.signal(effect, value)
    distance = np.linalg.norm(signal)
    assert distance == pytest.approx(DETECTION, rel=0.05)
    # prior and start are hardly drawn, so the spread is less than one by what they would have added
    expected = np.linalg.norm(short.project(signal)) / distance
    n, c, rng = WORLDS["arm"], short.commands, np.random.default_rng(11)
    outputs = []
    for _ in range(40):
        # a hundredth of the prior's spread: the projection is linear, a diagnosis refits
        errors = 0.01 * rng.standard_normal(len(nominal(n)))
        true = moved(n, {p.name: p.sigma * e for p, e in zip(nominal(n), errors, strict=True)})
        exact = fly(true, c, [effect.make(value, None, rng)])
        seen = short.project(short.distance_vector(measured(exact, c.time, rng)))
        outputs.append(seen @ signal / distance)
    assert np.mean(outputs) == pytest.approx(distance, abs=3.5 * expected / np.sqrt(40))
    assert np.std(outputs) == pytest.approx(expected, rel=0.35)


def test_what_is_left_of_a_signal():
    a, b = np.array([3.0, 4.0, 0.0]), np.array([1.0, 0.0, 0.0])
    assert distance_after(a, b[:, None]) == pytest.approx(4.0)
    assert distance_after(a, np.zeros((3, 0))) == pytest.approx(5.0)
    assert distance_after(a, np.array([b, 2 * b]).T) == pytest.approx(4.0), "dependent columns"


def test_one_without_a_trace_explains_nothing():
    signal, trace = np.array([3.0, 4.0]), np.array([1.0, 0.0])
    assert distance_after(signal, np.column_stack([trace, np.zeros(2)])) == pytest.approx(4.0)
    assert distance_after(signal, np.zeros((2, 1))) == pytest.approx(5.0)


def test_aliases_are_confirmed_only_near_the_limit(short):
    """A viscous and a Coulomb friction of the same joint merge at the limit, not at a hundred times it."""
    name = "joint_friction:coulomb@joint1"
    effect, one = hidden_effects("arm")[name], short.limit(name).value
    assert fisher.cannot_separate(short, effect, 0.3 * one, Named("joint_friction", "joint1", "viscous"))
    assert not fisher.cannot_separate(short, effect, 100 * one, Named("torque_gain", "joint3"))
    assert not fisher.cannot_separate(short, effect, 0.3 * one, Named("no_such_kind", "joint1"))


def test_another_shape_is_another_name(short):
    """Large enough to be told from a viscous one, a Coulomb friction is taken for its own shape only."""
    name = "joint_friction:coulomb@joint1"
    effect, one = hidden_effects("arm")[name], short.limit(name).value
    for shape, merges in (("viscous", False), ("coulomb", True), (None, True)):
        named = Named("joint_friction", "joint1", shape)
        assert fisher.cannot_separate(short, effect, 20 * one, named) is merges, shape


def test_what_no_run_hides_can_be_named():
    """The torque constant of a wheel that the panel's world leaves out, and a scale no channel shows."""
    for world, name in (
        ("panel", "torque_gain:error@wheel_z"),
        ("arm", "sensor_scale:scale@encoder.joint_position[joint2]"),
    ):
        assert name in nameable_effects(world)
        assert name not in hidden_effects(world)
        assert set(hidden_effects(world)) < set(nameable_effects(world))


def test_what_no_run_hides_is_compared_with(short):
    """Below the limit a bias passes for anything, a scale of that encoder; a hundred times it, no longer."""
    named = Named("sensor_scale", "encoder.joint_position[joint1]")
    effect = hidden_effects("arm")["sensor_bias:bias@encoder.joint_position[joint1]"]
    one = short.limit(effect.name).value
    assert fisher.cannot_separate(short, effect, 0.3 * one, named)
    assert not fisher.cannot_separate(short, effect, 100 * one, named)


def test_a_vector_is_named_with_all_its_axes():
    found = hidden_effects("rigid")["external_wrench:torque@bus_body"]
    assert Named("external_wrench", "bus", "torque, body").means(found)
    assert not Named("external_wrench", "bus", "torque, inertial").means(found)
    assert len(found.beside) == 3


def test_what_begins_late_is_told_from_less(short):
    """A friction of the last half second, of a size that eight seconds tell from a torque's gain."""
    name = "joint_friction:coulomb@joint1"
    effect, size = hidden_effects("arm")[name], 4 * short.limit(name).value
    assert np.linalg.norm(short.signal(effect, size, 7.5)) < 0.5 * np.linalg.norm(short.signal(effect, size))
    assert not fisher.cannot_separate(short, effect, size, Named("torque_gain", "joint3"))
    assert fisher.cannot_separate(short, effect, size, Named("torque_gain", "joint3"), 7.9)


def test_the_table_names_effects_that_exist():
    for world, limits in table().items():
        assert set(limits) <= set(hidden_effects(world))
        assert min(limits.values()) > 0.0
    assert strength_one("sms", "no such effect") is None


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS)
def test_the_table_is_what_is_found(world):
    """Limits found anew (cached in build/) are those of the table; what may never be that large has none."""
    exp, effects = fisher.experiment(world), hidden_effects(world)
    for name, value in table()[world].items():
        found, cap = exp.limit(name).value, effects[name].cap
        assert found > cap if value > cap else found == pytest.approx(value, rel=0.02), name
