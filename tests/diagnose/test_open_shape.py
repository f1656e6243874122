"""Laws whose shape is left open: what their errors do to parameters, and which law is told."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import _open_shape as open_shape
from smsid.diagnose._open_shape import may_be_open
from smsid.diagnose.score_test import Candidate
from smsid.diagnose.specification_tests import LAGS, _share_of_shape_errors, adequacy, open_joints, whiteness
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects import JointFriction, TorqueGain
from smsid.estimation._shape_errors import shape_errors
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.sensitivities import Sensitivity, propagate

JOINT = "joint2"


@pytest.fixture(scope="module")
def opened(known, problem):
    """The nominal fit with the torque of a joint erring by 0.01 N m."""
    dof = dict(zip(known.point.base.arm_joints.names, known.point.base.arm_joints.v, strict=True))[JOINT]
    noise = replace(problem.noise, shapes=((int(dof), 0.01),))
    return evaluate(known.point, known.unknowns, replace(problem, noise=noise))


def test_errors_of_all_octaves_together_are_a_torque_against_the_motion(opened):
    ((dof, _),) = opened.problem.noise.shapes
    found = shape_errors(opened.changes.model, opened.run, dof)
    at, middle = (np.sign(s.v[:, dof]) for s in (opened.run.states, opened.run.middle))
    (whole,) = np.moveaxis(propagate(opened.run, [Sensitivity.on(dof, middle, at)]), 2, 0)
    assert found.shape[2] > 3
    assert found.sum(axis=2) == pytest.approx(whole, abs=1e-9 * np.abs(whole).max())


def test_what_goes_by_the_load_errs_by_octaves_of_the_load_too(known, opened):
    """Both halves of the columns add up to friction that is in proportion to the load."""
    ((dof, _),) = opened.problem.noise.shapes
    rubs = JointFriction(name="rubs", joint=JOINT, load=0.05)
    opened = evaluate(known.point.with_effect(rubs), known.unknowns, opened.problem)
    found = shape_errors(opened.changes.model, opened.run, dof)
    at, middle = opened.run.states, opened.run.middle
    usual = np.sqrt(np.mean(at.tau[:, dof] ** 2))
    whole = [np.sign(s.v[:, dof]) * np.abs(s.tau[:, dof]) / usual for s in (middle, at)]
    (column,) = np.moveaxis(propagate(opened.run, [Sensitivity.on(dof, *whole)]), 2, 0)
    by_rate = len(np.unique(np.floor(np.log2(np.abs(np.r_[middle.v[:, dof], at.v[:, dof]])))))
    for part in (found[..., :by_rate], found[..., by_rate:]):
        assert part.shape[2] > 3
        half = column / np.sqrt(2.0)  # in squares
        assert part.sum(axis=2) == pytest.approx(half, abs=1e-9 * np.abs(half).max())


def test_an_error_of_shape_counts_in_every_interval(opened):
    """As far as a torque that repeats with the rate, by its standard deviation, moves the estimate."""
    ((dof, sigma),) = opened.problem.noise.shapes
    plain = np.linalg.inv(opened.gram) * np.outer(opened.scales, opened.scales)
    more = opened.covariance() - plain
    errors = shape_errors(opened.changes.model, opened.run, dof).reshape(opened.whitened[..., 0].size, -1)
    slopes = opened.whitened.reshape(len(errors), -1).T @ errors
    bent = plain @ (slopes / opened.scales[:, None]) * sigma
    assert np.diag(more) == pytest.approx((bent**2).sum(axis=1), rel=1e-3)
    assert (np.diag(more) > 0.0).all()


def test_a_torque_of_open_shape_is_not_asked_for_more(opened):
    assert open_joints(opened) == {JOINT: 0.01}
    asked = {t.location for t in adequacy(opened)}
    assert JOINT not in asked
    assert {"joint1", "joint3"} <= asked
    past = {t.where for t in adequacy(opened) if t.dependence == "its own past"}
    assert not any(name.endswith(f"[{JOINT}]") for name in past)


def test_only_laws_of_nature_there_all_the_time_may_be_open(opened, problem):
    rubs = JointFriction(name="rubs", joint=JOINT)
    own = Candidate("joint_friction", JOINT, "friction", "coulomb", rubs, ("rubs.coulomb",), (1e-3,))
    assert may_be_open(own, problem)
    assert not may_be_open(own, opened.problem)  # one joint at a time
    assert not may_be_open(replace(own, effect=rubs.model_copy(update={"start": 3.0})), problem)
    gain = TorqueGain(name="gain", joint=JOINT)
    assert not may_be_open(replace(own, effect=gain, free=("gain.error",)), problem)


@pytest.mark.parametrize("load", [0.0, 0.05])
def test_an_error_that_comes_again_with_rate_and_load_is_no_memory_of_a_channel(known, opened, load):
    """Load-dependent friction, told to 1 %, was not explained: the IMU felt what its sign lacked."""
    ((dof, _),) = opened.problem.noise.shapes
    rubs = JointFriction(name="rubs", joint=JOINT, coulomb=0.1, load=load)
    opened = evaluate(known.point.with_effect(rubs), known.unknowns, opened.problem)
    errors, rng = shape_errors(opened.changes.model, opened.run, dof), np.random.default_rng(3)
    by_rate = shape_errors(SimpleNamespace(loads=()), opened.run, dof)
    assert (errors.shape == by_rate.shape and np.allclose(errors, by_rate)) is not bool(load)
    size = 30.0 / np.sqrt((errors**2).sum(axis=(0, 1)).clip(1e-12))
    lacking = replace(
        opened.run, innovations=opened.run.innovations + errors @ (size * rng.choice((-1, 1), len(size)))
    )
    plain = {t.where: t.ratio for t in whiteness(opened)}
    seen = {t.where: t.ratio for t in whiteness(replace(opened, run=lacking))}
    closed = replace(opened.problem, noise=replace(opened.problem.noise, shapes=()))
    naive = {t.where: t.ratio for t in whiteness(replace(opened, run=lacking, problem=closed))}
    assert max(naive[n] - plain[n] for n in plain) > 100.0
    assert seen == pytest.approx(plain, rel=1e-6)


@pytest.mark.parametrize("load", [0.0, 0.05])
def test_an_error_of_shape_is_no_dependence_of_another_place(known, opened, load):
    """Load-dependent friction at its stall, told to 1.5 %, was not explained: an encoder depended on time."""
    ((dof, _),) = opened.problem.noise.shapes
    rubs = JointFriction(name="rubs", joint=JOINT, coulomb=0.1, load=load)
    opened = evaluate(known.point.with_effect(rubs), known.unknowns, opened.problem)
    errors, rng = shape_errors(opened.changes.model, opened.run, dof), np.random.default_rng(3)
    size = 30.0 / np.sqrt((errors**2).sum(axis=(0, 1)).clip(1e-12))
    lacking = replace(
        opened.run, innovations=opened.run.innovations + errors @ (size * rng.choice((-1, 1), len(size)))
    )

    def ratios(found):
        return {(t.where, t.dependence): t.ratio for t in adequacy(found)}

    plain, seen = ratios(opened), ratios(replace(opened, run=lacking))
    closed = replace(opened.problem, noise=replace(opened.problem.noise, shapes=()))
    naive = ratios(replace(opened, run=lacking, problem=closed))
    assert max(naive[n] - plain[n] for n in plain) > 100.0
    assert max(seen[n] - plain[n] for n in plain) < 1.0


def test_what_an_error_of_shape_cannot_do_is_still_found(opened):
    """Power of the tests beside it: a bias of another channel shows as much as where no shape is open."""
    rate = opened.problem.data.names.index("encoder.joint_velocity[joint3]")
    innovations = opened.run.innovations.copy()
    innovations[len(innovations) // 2 :, rate] += 0.6
    off = replace(opened, run=replace(opened.run, innovations=innovations))
    closed = replace(off, problem=replace(off.problem, noise=replace(off.problem.noise, shapes=())))

    def ratio(found):
        return next(
            t.ratio for t in adequacy(found) if (t.where, t.dependence) == ("encoder.joint_velocity", "time")
        )

    assert ratio(closed) > 50.0
    assert ratio(off) > 0.8 * ratio(closed)


@pytest.mark.parametrize(("sigma", "asked"), [(1e-4, True), (0.3, False)])
def test_what_errors_of_shape_shake_need_not_be_white(known, problem, opened, sigma, asked):
    """A light link beyond a joint whose friction is open had half the variance of its tachometer by that, and
    friction told to 3 % stood beside "its own past".
    """
    ((dof, _),) = opened.problem.noise.shapes
    loud = replace(problem, noise=replace(problem.noise, shapes=((dof, sigma),)))
    found = evaluate(known.point, known.unknowns, loud)
    names = [n for n in problem.data.names if not n.endswith(f"[{JOINT}]")]
    near = "encoder.joint_velocity[joint3]"
    assert (near in {t.where for t in whiteness(found)}) is asked
    shares = dict(zip(problem.data.names, _share_of_shape_errors(found), strict=True))
    assert all(-1e-9 < shares[n] < 1.0 for n in names)
    assert (shares[near] > THRESHOLDS.shape_share) is not asked
    assert {t.where for t in whiteness(found)} <= {n for n in names if shares[n] <= THRESHOLDS.shape_share}


def test_beside_an_open_shape_memory_has_the_size_it_says(opened):
    """Noise of which no torque knows anything: what is fitted of it takes no false memory with it."""
    rng, ratios = np.random.default_rng(5), []
    for _ in range(40):
        noise = replace(opened.run, innovations=rng.standard_normal(opened.run.innovations.shape))
        ratios += [t.ratio for t in whiteness(replace(opened, run=noise))]
    assert np.mean(ratios) == pytest.approx(LAGS, rel=0.06)


@pytest.mark.parametrize(("dearer", "named"), [(-1.0, True), (5.0, True), (8.0, False)])
def test_a_simpler_law_that_errs_is_named_where_it_is_about_as_likely(monkeypatch, dearer, named):
    """Coulomb friction of 8000 times its limit was a Stribeck curve, of 1.96 +- 1.6 N m at 2.5 mrad/s: it had
    been better before any law could err.
    """

    def law(*free):
        own = SimpleNamespace(free=free, key=("joint_friction", "joint1", free[-1]), location="joint1")
        own.holds, own.extends = lambda other: set(other.free) < set(free), lambda other: False
        own.unknowns = lambda rest: [SimpleNamespace(name=n) for n in free]
        return own

    coulomb, stribeck, viscous = law("coulomb"), law("coulomb", "stribeck"), law("viscous")
    unknowns = [SimpleNamespace(name=n) for n in ("mass", "coulomb", "stribeck")]
    erring = SimpleNamespace(objective=0.0, point=None, problem=None, unknowns=unknowns,
                             run=SimpleNamespace(samples=1000))  # fmt: skip
    alone = SimpleNamespace(name="alone")
    price = 2.0 * np.log(1000.0) + dearer
    for name, stub in {
        "_dof": lambda *_: 6,
        "_further": lambda *_: [],
        "may_be_open": lambda *_: True,
        "_fit_torque_noise": lambda *_: erring,
        "_fit_alone": lambda found, some, laws, every, rest, dof: (price, alone),
        "_causes": lambda found, rest, some, others: (some, set(others)),
    }.items():
        monkeypatch.setattr(open_shape, name, stub)
    found, causes = open_shape.with_errors_of_shape(erring, stribeck, [stribeck, coulomb, viscous])
    assert (found is alone) is named
    assert causes == (((coulomb,), {stribeck.key}) if named else ())
