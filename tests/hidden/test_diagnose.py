"""An effect is hidden in MuJoCo; the diagnosis has to find it. Nothing but diagnosis.json is read.

Seeds and strengths are fixed here; the study over many is benchmarks/hidden_effects.py.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from smsid.description import load_description
from smsid.identify.estimate import load_estimate
from smsid.recording import load_recording

from .catalogue import hidden_effects
from .judge import Injected
from .plan import Run, draw_run, inject
from .study import diagnosis_of, judged, run_and_judge, tamed

diagnose = pytest.importorskip("smsid.diagnose").diagnose

RIGHT = ("right", "right_by_alias")
OPEN = ("unexplained", "right_family")


def hide(seed, category, world, *effects):
    rng = np.random.default_rng([seed, 80])
    hidden = tuple(inject(world, hidden_effects(world)[name], strength, rng) for name, strength in effects)
    return Run(seed, category, world, hidden)


QUICK = [
    (hide(1, "nothing", "arm"), RIGHT),
    (hide(2, "single", "arm", ("torque_gain:error@joint2", 10.0)), RIGHT),
]
SLOW = [
    (hide(3, "single", "rigid", ("joint_friction:viscous@joint2", 10.0)), RIGHT),
    (hide(4, "nothing", "sms"), RIGHT),
    (hide(5, "nothing", "panel"), RIGHT),
    (hide(6, "single", "sms", ("joint_friction:coulomb@joint3", 10.0)), RIGHT),
    (hide(7, "single", "sms", ("motor_inertia:inertia@joint2", 10.0)), RIGHT),
    (hide(8, "single", "sms", ("payload:mass@tool", 10.0)), RIGHT),
    (hide(9, "single", "sms", ("slosh_nonlinearity:cubic@tank", 10.0)), RIGHT),
    (hide(10, "single", "panel", ("geometric_stiffness:factor@panel", 10.0)), RIGHT),
    (hide(11, "single", "rigid", ("thruster_gain:gain.y@thruster", 10.0)), RIGHT),
    (hide(12, "single", "rigid", ("external_wrench:force@bus_inertial", 10.0)), RIGHT),
    (hide(18, "single", "rigid", ("gravity_gradient:rate@bus", 3.0)), RIGHT),
    (hide(19, "single", "sms", ("body_error:mass@bus", 100.0)), RIGHT),
    (hide(20, "single", "sms", ("wheel_imbalance:static@wheel_y", 100.0)), RIGHT),
    (hide(21, "single", "sms", ("mass_loss:rate@bus", 100.0)), RIGHT),
    (hide(13, "single", "sms", ("sensor_bias:bias.z@imu.angular_rate", 10.0)), RIGHT),
    (hide(14, "single", "arm", ("joint_friction:coulomb@joint2", 10.0)), RIGHT),
    (hide(15, "outside", "sms", ("outside:torque_ripple@joint2", 10.0)), OPEN),
    (hide(22, "outside", "rigid", ("outside:dahl@joint2", 10.0)), OPEN),
    # 970 s, and another slosh mass stood beside it
    (draw_run(345019), OPEN),
    # a mode of the panel that the second, slosh, made unnecessary could not be taken out
    (draw_run(345029), RIGHT),
    # the position stood still where it was smallest, and was refused as saturated
    (draw_run(345055), RIGHT),
    # one base parameter, of three links and a motor, was four names
    (draw_run(346022), RIGHT),
    (draw_run(346193), RIGHT),
    # a gain at joint3 was gains at joint1 and joint2, of the other sign
    (draw_run(346102), RIGHT),
    # a link's centre of mass went on making up for what its inertia lacked, which a payload had replaced
    (draw_run(346147), RIGHT),
    # a further mode, told from nothing by its profile alone
    (draw_run(346154), RIGHT),
    (hide(16, "pair", "sms", ("torque_gain:error@wheel_y", 20.0), ("lever_arm:offset.x@imu", 20.0)), RIGHT),
]


def named(case):
    run, _ = case
    return f"{run.world}-{'+'.join(i.effect.name for i in run.hidden) or 'nothing'}"


@pytest.mark.parametrize(("run", "wanted"), QUICK, ids=map(named, QUICK))
def test_hidden(run, wanted, tmp_path):
    row = run_and_judge(run, tmp_path)
    assert row["outcome"] in wanted, f"{row['outcome']}: named {row['named']}; {row['sentence']}"


@pytest.mark.slow
@pytest.mark.parametrize(("run", "wanted"), SLOW, ids=map(named, SLOW))
def test_hidden_slow(run, wanted, tmp_path):
    row = run_and_judge(run, tmp_path)
    assert row["outcome"] in wanted, f"{row['outcome']}: named {row['named']}; {row['sentence']}"


@pytest.mark.parametrize(
    ("seed", "name", "strength", "onset", "off"),
    [
        (17, "joint_friction:viscous@joint2", 10.0, 35.0, 2.0),
        pytest.param(  # its torque changes sign: many maxima, as in `..sought_again_at_the_noise`
            18, "torque_gain:error@joint1", 30.0, 24.6235, 0.1, marks=pytest.mark.slow
        ),
    ],
)
def test_when_it_began(seed, name, strength, onset, off, tmp_path):
    rng = np.random.default_rng([seed, 80])
    hidden = inject("arm", hidden_effects("arm")[name], strength, rng, onset)
    row = run_and_judge(Run(seed, "onset", "arm", (hidden,)), tmp_path)
    assert row["outcome"] in RIGHT, row["sentence"]
    (cause,) = json.loads((tmp_path / "diagnosis.json").read_text())["causes"]
    assert abs(cause["onset"] - onset) < off
    assert 0.0 < cause["onset_sigma"] < off


def test_more_of_a_described_friction_begins(tmp_path):
    """A description that a diagnosis has extended has an effect of the name that a new cause would get."""
    rng = np.random.default_rng([17, 80])
    hidden = inject("arm", hidden_effects("arm")["joint_friction:viscous@joint2"], 10.0, rng, 35.0)
    run, files = tamed(Run(17, "onset", "arm", (hidden,)), tmp_path)
    known = {"kind": "joint_friction", "name": "joint_friction_joint2", "joint": "joint2", "viscous": 1e-7}
    with files.description.open("a", encoding="utf-8") as text:
        text.write("\n[[effect]]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in known.items()))
    found = judged(run, diagnosis_of(files, tmp_path))
    assert found.outcome in RIGHT, found
    (cause,) = json.loads((tmp_path / "diagnosis.json").read_text())["causes"]
    assert abs(cause["onset"] - 35.0) < 2.0
    assert cause["parameters"][0]["name"] == "joint_friction_joint2_later.viscous"


def test_a_beginning_is_sought_again_at_the_noise(tmp_path):
    """First seen beside what the model does not follow, it is 0.14 s early; that was left unexplained."""
    effect, onset = hidden_effects("arm")["torque_gain:error@joint1"], 31.339377
    hidden = Injected(effect, 4.803e-4, 30.0, onset)
    row = run_and_judge(Run(190085, "onset", "arm", (hidden,)), tmp_path)
    assert row["outcome"] in RIGHT and row["alone"], row["sentence"]
    (cause,) = json.loads((tmp_path / "diagnosis.json").read_text())["causes"]
    assert abs(cause["onset"] - onset) < 0.02


def test_what_is_proven_is_named_beside_what_no_cause_explains(tmp_path):
    """A ripple at another joint, which the catalogue has not; the motor's gain is written all the same."""
    effects = (("outside:torque_ripple@joint1", 10.0), ("torque_gain:error@joint3", 30.0))
    run, files = tamed(hide(23, "pair", "arm", *effects), tmp_path)
    recording, estimate = load_recording(files.recording), load_estimate(files.estimate)
    made = diagnose(load_description(files.description), [recording], estimate=estimate, rate=10.0)
    d = made.diagnosis
    assert d.verdict == "unexplained"
    (cause,) = d.causes
    assert (cause.effect, cause.location) == ("torque_gain", "joint3")
    (value,) = cause.parameters
    assert abs(value.value - run.hidden[1].value) < 3.0 * value.sigma
    assert "torque of joint1 depends on ripple over the angle" in d.sentence
    assert "What stands all the same: torque constant" in d.sentence
    (written,) = (e for e in made.extended.effect if e.kind == "torque_gain")
    assert written.error == value.value


@pytest.mark.slow
def test_a_strong_one_has_many_beginnings_close_to_each_other(tmp_path):
    """Its torque changes sign: found 1.5 s early, the torque constant was 13.6 standard deviations off."""
    effect = hidden_effects("sms")["torque_gain:error@joint3"]
    run = Run(290256, "onset", "sms", (Injected(effect, -6.561e-4, 30.0, 25.803529),))
    row = run_and_judge(run, tmp_path)
    assert row["outcome"] in RIGHT and row["alone"], row["sentence"]
    (cause,) = json.loads((tmp_path / "diagnosis.json").read_text())["causes"]
    assert cause["onset"] == pytest.approx(25.85, abs=0.03)  # when the next command came
    assert abs(row["deviation"]) < 3.0


def test_a_clock_that_is_early_reads_what_the_next_command_does(tmp_path):
    """A hundred times its limit, what an encoder reads before its time shows the jump of the torque."""
    effect = hidden_effects("arm")["time_offset:offset@encoder"]
    hidden = Injected(effect, -3.496e-4, 100.0)
    row = run_and_judge(Run(40174, "single", "arm", (hidden,)), tmp_path)
    assert row["outcome"] in RIGHT and row["alone"], row["sentence"]
    assert abs(row["deviation"]) < 3.0
