"""A coarse encoder that repeats itself: at rest where the motion rests, stuck where it goes on."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose._sensor_faults import (
    drop_samples,
    inflate_for_quantisation,
    quantised_channels,
    resting_channels,
    stuck_channels,
)
from smsid.diagnose.diagnose import diagnose
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.inputs.inputs import JointMotion
from smsid.inputs.signals import Sampled
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import observe
from smsid.simulate import Inputs, simulate, truth_of

CHANNEL, STEP = "encoder.joint_position", 2e-3
STOP = 9.0  # [s]


def flown(description, ends):
    """Return a recording that begins in motion, which ends after ``ends`` [s], read in coarse steps."""
    model = build_model(description)
    times = np.arange(-6.0, 2.0 * STOP, 0.01)
    s = np.clip((times + ends) / (2.0 * ends), 0.0, 1.0)
    shape = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    angles = np.outer(shape, [0.3, 0.5, -0.4]) + np.array([2e-4, 3e-4, -1e-4])
    later = times >= 0.0
    motion = Sampled.from_samples(times[later], angles[later], 5)
    q0 = model.set_joint_angles(model.home, angles[later][0])
    trajectory = simulate(model, Inputs(joint_motion=JointMotion.of(motion)), STOP, q0=q0)
    sensors = description.effective_sensors()
    truth = truth_of(trajectory, sensors)
    exact = [name for name in truth(np.zeros(1)) if name.startswith(("command.", "truth"))]
    recording = observe(
        truth, sensors, start=0.0, stop=STOP, known_until=STOP, rng=np.random.default_rng(1), exact=exact,
        rate=None, labels={"joint": list(model.arm_joints.names), "wheel": list(model.wheels.names)},
        role="estimation", name="rest", provenance={},
    )  # fmt: skip
    dataset = recording.dataset.copy(deep=True)
    dataset[CHANNEL].values[:] = np.round(dataset[CHANNEL].values / STEP) * STEP
    return dataset


@pytest.fixture(scope="module")
def rests(description):
    return flown(description, 5.0)


@pytest.mark.parametrize("stuck", [False, True])
def test_what_repeats_itself_rests_where_the_model_says_so(known, description, rests, stuck):
    dataset = rests
    if stuck:
        dataset = flown(description, 14.0)  # it goes on to the end
        x = dataset[CHANNEL].values
        x[len(x) // 2 :, 1] = x[len(x) // 2, 1]
    whole = measurements_of(known.point.base, Recording(dataset), description.effective_sensors())
    rounded = quantised_channels(whole)
    faults = stuck_channels(whole)
    assert f"{CHANNEL}[joint2]" in {f.component for f in faults} and all(f.doubtful for f in faults)
    data = inflate_for_quantisation(drop_samples(whole, faults).thinned(10.0), rounded)
    problem = Problem(
        Recording(dataset), data, np.array([], dtype=int), CommandTiming("linear", "right"), ProcessNoise()
    )
    found = evaluate(known.point, known.unknowns[:1], problem)
    rest = {f.component for f in resting_channels(found, whole, faults)}
    assert (f"{CHANNEL}[joint2]" in rest) != stuck
    certain = [replace(f, doubtful=False) for f in faults]
    assert not resting_channels(found, whole, certain)


@pytest.mark.slow
def test_an_arm_that_comes_to_rest_has_no_stuck_encoder(description, rests):
    found = diagnose(description, [Recording(rests)], rate=10.0).diagnosis
    assert [(c.effect, c.location.split("[")[0]) for c in found.causes] == [("quantisation", CHANNEL)]
