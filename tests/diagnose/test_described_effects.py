"""Effects that a description lists: nominal as far as they are known, and candidates from where they are."""

import numpy as np
import pytest

from smsid.description import load_description
from smsid.diagnose import diagnose
from smsid.diagnose._described_effects import from_described, least_beside_listed, least_for
from smsid.diagnose._without_cause import residual_squares, without_cause
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import nominal
from smsid.effects import Backlash, ExternalWrench, JointFriction, Payload, SensorBias
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.parameter_vector import Point
from smsid.identify.estimate import Estimate, ParameterEstimate, load_estimate
from smsid.recording import load_recording
from tests.hidden.catalogue import hidden_effects
from tests.hidden.plan import Run, inject
from tests.hidden.study import tamed

RUBS = JointFriction(name="rubs", joint="joint2", coulomb=0.5, viscous=2.0)


def by_key(point, problem, unknowns):
    return {c.key: c for c in propose(point, problem, unknowns)}


def test_what_is_known_of_an_effect_is_nominal(description):
    """By the description's prior or by the estimate, and its shape with it, which nature has in size only;
    what neither knows stays as it is.
    """

    def names(effect, estimate=None):
        return {u.name: u.sigma for u in nominal(description.with_effects(effect), estimate).unknowns}

    stated = RUBS.model_copy(update={"prior": {"coulomb": 0.07}})
    assert {n: s for n, s in names(stated).items() if n.startswith("rubs")} == {
        "rubs.coulomb": 0.07,
        "rubs.smoothing": RUBS.smoothing,
    }
    exact = stated.model_copy(update={"known": ("smoothing",)})
    assert [n for n in names(exact) if n.startswith("rubs")] == ["rubs.coulomb"]
    own = ParameterEstimate("rubs.viscous", 2.2, "N m s/rad", 0.3, "identifiable", "maximum_likelihood")
    found = names(RUBS, Estimate(description.name, "ml", (own,), covariance=np.array([[0.09]])))
    assert {n: s for n, s in found.items() if n.startswith("rubs.v")} == {"rubs.viscous": 0.3}
    assert not [n for n in names(RUBS) if n.startswith("rubs")]


def test_a_candidate_is_from_where_its_effect_is_described(description, problem):
    """By whatever name: what does nothing is what the description has, and the prior holds no more."""
    listed = description.with_effects(RUBS.model_copy(update={"prior": {"coulomb": 0.07}}))
    known = nominal(listed, None)
    found = by_key(known.point, problem, known.unknowns)
    candidate = found["joint_friction", "joint2", "coulomb"]
    assert candidate.free == ("rubs.coulomb",)
    (unknown,) = candidate.unknowns(known.unknowns)
    assert (unknown.nominal, unknown.sigma) == (0.5, np.inf) and not candidate.one_sided
    other = found["joint_friction", "joint3", "coulomb"]
    assert other.effect.name != "rubs" and other.effect.coulomb == 0.0


@pytest.mark.parametrize(
    "listed",
    [
        RUBS.model_copy(update={"joint": "joint3"}),
        RUBS.model_copy(update={"start": 3.0}),
        Payload(name="rubs", frame="tool", mass=1.0),
    ],
    ids=["elsewhere", "later", "another kind"],
)
@pytest.mark.parametrize("name", ["rubs", "joint_friction_joint2"])
def test_what_acts_elsewhere_or_later_is_another_effect(description, problem, known, listed, name):
    """Also where it has the name that the candidate would have: as a diagnosis writes what begins midway."""
    candidate = by_key(known.point, problem, known.unknowns)["joint_friction", "joint2", "coulomb"]
    other = listed.model_copy(update={"name": name})
    found = from_described(candidate, Point.of(description.with_effects(other)))
    assert found.beside is None and found.effect.coulomb == 0.0 and found.effect.joint == "joint2"
    assert (found is candidate) is (name == "rubs")
    assert found.effect.name != name and all(n.startswith(f"{found.effect.name}.") for n in found.free)


def test_one_component_is_not_the_whole_sensor(description, problem):
    """What is listed of one axis has no parameters for the three that a candidate frees."""
    one = SensorBias(name="mine", sensor="imu", quantity="angular_rate", component="x", bias=1e-4)
    known = nominal(description.with_effects(one), None)
    found = by_key(known.point, problem, known.unknowns)["sensor_bias", "imu.angular_rate", "bias"]
    assert found.beside is None and found.effect.name != "mine"
    assert {p.name for p in found.effect.parameters()} >= set(found.free)


def test_a_gap_is_searched_beside_one_that_is_listed(description, problem):
    """What is profiled has its own start and bounds: none of them are those of the described effect."""
    own = Backlash(name="play", joint="joint2", gap=1e-3, quasistatic=True, prior={"gap": 1e-4})
    known = nominal(description.with_effects(own), None)
    found = by_key(known.point, problem, known.unknowns)["backlash", "joint2", "backlash"]
    assert found.beside is None and found.effect.name != "play" and found.effect.gap == 0.0


def test_a_bias_is_counted_once(description):
    sensors = description.effective_sensors()
    name = next(s.name for s in sensors if s.kind == "imu")
    listed = description.with_effects(
        SensorBias(name="mine", sensor=name, quantity="angular_rate", prior={"bias.x": 1e-5})
    )
    names = [u.name for u in nominal(listed, None).unknowns]
    assert "mine.bias.x" in names and f"{name}.angular_rate.bias.x" not in names


def test_axes_tell_effects_of_a_kind_apart(description, problem):
    leak = ExternalWrench(name="leak", frame="inertial", force=(0.1, 0.0, 0.0))
    known = nominal(description.with_effects(leak), None)
    found = by_key(known.point, problem, known.unknowns)
    assert found["external_wrench", "bus", "force, inertial"].effect.name == "leak"
    assert found["external_wrench", "bus", "force, body"].effect.name != "leak"


def test_less_a_cause_its_effect_is_as_described_and_bound(description, calm, problem):
    listed = description.with_effects(RUBS.model_copy(update={"prior": {"coulomb": 0.07}}))
    known = nominal(listed, None)
    candidate = by_key(known.point, problem, known.unknowns)["joint_friction", "joint2", "coulomb"]
    bound = tuple(u for u in known.unknowns if u.name == "rubs.coulomb")
    plain = evaluate(known.point, (*known.unknowns[:1], *bound), calm)
    moved = known.point.with_effect(listed.get_effect("rubs").model_copy(update={"coulomb": 0.9}))
    last = evaluate(moved, (*known.unknowns[:1], *candidate.unknowns(plain.unknowns)), calm)
    less = without_cause(last, candidate, plain)
    assert [u.name for u in less.unknowns] == [u.name for u in plain.unknowns]
    assert less.unknowns[1] == bound[0]
    again = less.point.description.get_effect("rubs")
    assert (again.coulomb, again.viscous) == (0.5, 2.0)


def test_what_a_listed_effect_explains_is_told_beside_its_prior(description, calm, problem):
    """Two standard deviations off: a ratio of some 4, whatever the steps of candidate and prior are."""
    rubs = RUBS.model_copy(update={"coulomb": 0.14, "viscous": 0.0, "prior": {"coulomb": 0.07}})
    known = nominal(description.with_effects(rubs), None)
    candidate = by_key(known.point, problem, known.unknowns)["joint_friction", "joint2", "coulomb"]
    bound = tuple(u for u in known.unknowns if u.name == "rubs.coulomb")
    plain = evaluate(known.point, (*known.unknowns[:1], *bound), calm)
    right = known.point.with_effect(rubs.model_copy(update={"coulomb": 0.0}))
    last = evaluate(right, (*known.unknowns[:1], *candidate.unknowns(plain.unknowns)), calm)
    less = without_cause(last, candidate, plain)
    ratio = residual_squares(less) - residual_squares(last)
    assert ratio == pytest.approx((0.14 / 0.07) ** 2, rel=0.3)


def test_what_is_little_beside_a_listed_law_may_be_its_shape(description, calm, problem):
    """As beside a cause, a thousandth of it; at its own joint alone."""
    listed = description.with_effects(RUBS.model_copy(update={"prior": {"coulomb": 0.07}}))
    known = nominal(listed, None)
    own = tuple(u for u in known.unknowns if u.name == "rubs.coulomb")
    found = evaluate(known.point, (*known.unknowns[:1], *own), calm)
    candidates = propose(known.point, problem, known.unknowns)
    expected = 1e-3 * (0.5 / found.sigma("rubs.coulomb")) ** 2
    assert least_beside_listed(found, candidates) == {("joint2", "friction"): pytest.approx(expected)}
    held = evaluate(known.point, known.unknowns[:1], calm)
    assert least_beside_listed(held, candidates) == {}
    least, every = least_beside_listed(found, candidates), {c.key: c for c in candidates}
    other = every["joint_friction", "joint2", "load-dependent"]
    assert least_for(other, found, least) == pytest.approx(expected)
    for key in (("joint_friction", "joint2", "coulomb"), ("joint_friction", "joint3", "viscous")):
        assert least_for(every[key], found, least) == 0.0, "an error in size, or another joint"
    assert least_for(every["torque_gain", "joint2", "torque constant"], found, least) == 0.0


def listed_friction(tmp_path, off, name="rubs", times=20.0):
    """Diagnose an arm whose Coulomb friction, ``times`` its limit of detection, is listed with a standard
    deviation, and ``off`` by so many.
    """
    effect = hidden_effects("arm")["joint_friction:coulomb@joint2"]
    hidden = inject("arm", effect, times, np.random.default_rng(5))
    run, files = tamed(Run(7000, "single", "arm", (hidden,)), tmp_path)
    true = run.hidden[0].value
    sigma = 4e-4 if abs(off) < 5 else 5e-5
    stated = JointFriction(name=name, joint="joint2", coulomb=true + off * sigma, prior={"coulomb": sigma})
    given = load_description(files.description).with_effects(stated)
    made = diagnose(given, [load_recording(files.recording)], estimate=load_estimate(files.estimate))
    return made, true


def test_an_error_within_what_is_known_is_no_cause(tmp_path):
    """Two of its standard deviations, fifteen of what the recording knows it to: 1 in 20 is as far off."""
    made, _ = listed_friction(tmp_path, 2.0)
    assert made.diagnosis.verdict == "adequate", made.diagnosis.sentence


@pytest.mark.parametrize("times", [20.0, 100.0])
def test_an_error_beyond_it_is_named_by_what_it_is_now(tmp_path, times):
    """Of a strong one too, beside which it is little: it is no error of its shape."""
    made, true = listed_friction(tmp_path, 20.0, times=times)
    (cause,) = made.diagnosis.causes
    value, width = cause.parameters
    assert width.name == "rubs.smoothing" and abs(width.value - width.nominal) < 4.0 * width.sigma
    assert (cause.effect, value.name) == ("joint_friction", "rubs.coulomb")
    assert abs(value.value - true) < 4.0 * value.sigma and abs(value.nominal - true - 1e-3) < 1e-12
    assert [e.name for e in made.extended.effect if e.kind == "joint_friction"] == ["rubs"]
