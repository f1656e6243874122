"""The judge: every outcome, from hand-written diagnoses."""

from __future__ import annotations

import pytest

from .catalogue import hidden_effects
from .judge import Injected, judge


def cause(effect, location, family, shape, parameter="x", value=1.0, aliases=(), fitted=None):
    parameters = [{"name": f"e.{parameter}", "value": value, "sigma": 0.5, "unit": "N m", "nominal": None}]
    listed = [{"effect": e, "location": at, "family": f, "shape": s} for e, at, f, s in aliases]
    return {
        "effect": effect, "location": location, "family": family, "shape": shape,
        "fitted": fitted or parameter, "parameters": parameters, "aliases": listed,
    }  # fmt: skip


def document(*causes, verdict="explained", remaining=()):
    return {"verdict": verdict, "causes": list(causes), "remaining": list(remaining)}


def hidden(name, value=2.0):
    return Injected(hidden_effects("sms")[name], value, 3.0)


COULOMB = "joint_friction:coulomb@joint2"
RIGHT = ("joint_friction", "joint2", "friction", "coulomb", "coulomb")
VISCOUS = ("joint_friction", "joint2", "friction", "viscous")


def outcome(doc, *truth, confirmed=True):
    return judge(doc, truth, lambda *_: confirmed).outcome


def test_nothing_hidden():
    assert outcome(document(verdict="adequate")) == "right"
    assert outcome(document(verdict="unexplained")) == "false_alarm"
    assert outcome(document(cause(*RIGHT))) == "false_alarm"


def test_right_alone_and_in_a_set():
    found = judge(document(cause(*RIGHT)), [hidden(COULOMB)], lambda *_: False)
    assert (found.outcome, found.alone) == ("right", True)
    assert found.deviation == pytest.approx(-2.0)
    beside = judge(
        document(cause(*RIGHT[:3], None, "coulomb", aliases=[VISCOUS])), [hidden(COULOMB)], lambda *_: False
    )
    assert (beside.outcome, beside.alone) == ("right", False)


def test_what_was_fitted_counts_where_no_shape_is_named():
    """A mode's damping, not told from another's: the parameter is called the same in both."""
    truth = Injected(hidden_effects("panel")["beam_appendage:mode2.damping@panel"], 0.02, 3.0)
    place = ("mode_error", "panel", "appendage")
    for mode, expected in ((2, "right"), (1, "right_family")):
        other = (*place, "damping of mode 3")
        own = cause(*place, None, "damping", aliases=[other], fitted=f"damping of mode {mode}")
        assert outcome(document(own), truth) == expected


def test_an_alias_counts_only_when_confirmed_and_few():
    alias = ("joint_friction", "joint2", "friction", "coulomb")
    delay = cause("actuator_delay", "joint2", "actuator", "delay", aliases=[alias])
    assert outcome(document(delay), hidden(COULOMB)) == "right_by_alias"
    assert outcome(document(delay), hidden(COULOMB), confirmed=False) == "wrong_family"
    crowd = cause("actuator_delay", "joint2", "actuator", "delay", aliases=[alias, VISCOUS, VISCOUS])
    assert outcome(document(crowd), hidden(COULOMB)) == "wrong_family"


def test_one_base_parameter_is_one_alias_wherever_it_is_said():
    """The inertia of a link beyond a joint, where what is hidden is that of another link or a motor."""
    there = ("joint_friction", "joint1", "friction", "coulomb")
    delay = cause("actuator_delay", "joint1", "actuator", "delay", aliases=[there, VISCOUS])
    delay["aliases"][0]["also_at"] = ["joint2", "joint3"]
    assert outcome(document(delay), hidden(COULOMB)) == "right_by_alias"
    assert outcome(document(delay), hidden(COULOMB), confirmed=False) == "wrong_family"
    same = cause(*there, "coulomb")
    assert outcome(document(same), hidden(COULOMB)) == "wrong_family"
    assert outcome(document({**same, "also_at": ["joint2"]}), hidden(COULOMB)) == "right_by_alias"


@pytest.mark.parametrize(("shape", "fitted"), [("delay", None), (None, "delay")])
def test_what_is_named_is_confirmed_with_its_shape(shape, fitted):
    """Or with the one that was fitted where none is named."""
    asked = []
    alias = ("joint_friction", "joint2", "friction", "coulomb")
    delay = cause("actuator_delay", "joint2", "actuator", shape, "delay", aliases=[alias], fitted=fitted)
    judge(document(delay), [hidden(COULOMB)], lambda truth, *named: asked.append(named) or True)
    assert asked == [("actuator_delay", "joint2", "delay")]


def test_family_shape_and_place():
    assert outcome(document(cause(*VISCOUS)), hidden(COULOMB)) == "right_family"
    assert (
        outcome(document(cause("joint_friction", "joint3", "friction", "coulomb")), hidden(COULOMB))
        == "wrong_family"
    )
    assert (
        outcome(document(cause("torque_gain", "joint2", "actuator", "torque constant")), hidden(COULOMB))
        == "wrong_family"
    )


def test_extra_missed_unexplained():
    payload = cause("payload", "tool", "inertia", "payload")
    assert outcome(document(cause(*RIGHT), payload), hidden(COULOMB)) == "extra"
    assert outcome(document(verdict="adequate"), hidden(COULOMB)) == "missed"
    assert outcome(document(verdict="unexplained"), hidden(COULOMB)) == "unexplained"
    assert outcome(document(payload, verdict="unexplained"), hidden(COULOMB)) == "wrong_family"
    assert outcome(document(verdict="not_evaluated"), hidden(COULOMB)) == "not_evaluated"


def test_outside_the_catalogue():
    ripple = hidden("outside:torque_ripple@joint2")
    left = {"where": "joint2", "dependence": "angle"}
    found = judge(document(verdict="unexplained", remaining=[left]), [ripple], lambda *_: True)
    assert (found.outcome, found.equation) == ("unexplained", True)
    assert outcome(document(cause(*RIGHT)), ripple) == "right_family"
    assert outcome(document(cause("payload", "tool", "inertia", "payload")), ripple) == "wrong_family"


def test_pairs():
    other = hidden("payload:mass@tool")
    payload = cause("payload", "tool", "inertia", "payload")
    assert outcome(document(payload, cause(*RIGHT)), hidden(COULOMB), other) == "right"
    assert outcome(document(payload), hidden(COULOMB), other) == "partial"


def test_component_of_a_sensor():
    stuck = hidden("stuck:duration@imu.angular_rate")
    assert outcome(document(cause("stuck", "imu.angular_rate.x", "sensor", "stuck")), stuck) == "right"
    assert outcome(document(cause("stuck", "imu.acceleration.x", "sensor", "stuck")), stuck) == "right_family"


@pytest.mark.parametrize(("where", "right"), [("torque of joint2", True), ("torque of joint3", False)])
def test_the_torque_of_a_joint_is_the_equation_of_the_joint(where, right):
    doc = document(verdict="unexplained", remaining=[{"where": where, "dependence": "angle"}])
    found = judge(doc, [hidden("outside:torque_ripple@joint2")], lambda *_: True)
    assert (found.outcome, found.equation) == ("unexplained", right)
