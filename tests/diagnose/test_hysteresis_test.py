"""The test for hysteresis: its law, and that it is told from what the catalogue has at the joint."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose.hypotheses import propose
from smsid.diagnose.specification_tests import hysteresis, memory
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.sensitivities import Sensitivity, propagate

WIDTH = 0.05


def test_the_torque_turns_over_the_width():
    angle = np.concatenate([np.linspace(0.0, 1.0, 201), np.linspace(1.0, 0.8, 41)[1:]])
    middle = 0.5 * (angle[1:] + angle[:-1])
    at, between = hysteresis(angle, middle, WIDTH)
    assert at[0] == 0.0
    assert at[200] == pytest.approx(1.0, abs=1e-6)
    assert at[210] == pytest.approx(-1.0 + 2.0 * np.exp(-0.05 / WIDTH))
    assert between[205] == pytest.approx(-1.0 + 2.0 * np.exp(-0.0275 / WIDTH))


@pytest.mark.parametrize("there", [True, False])
def test_it_is_found_beside_coulomb_friction(known, problem, there):
    found = evaluate(known.point, known.unknowns, problem)
    joint = "joint2"
    arm = found.changes.model.arm_joints
    k = list(arm.names).index(joint)
    kq, kv = int(arm.q[k]), int(arm.v[k])
    coulomb = next(
        c for c in propose(known.point, problem, known.unknowns)
        if (c.location, c.shape) == (joint, "coulomb")
    )  # fmt: skip
    found = evaluate(
        known.point.with_effect(coulomb.effect), (*known.unknowns, *coulomb.unknowns(())), problem
    )
    run = found.run
    travel = float(np.ptp(run.states.q[:, kq]))
    law = hysteresis(run.states.q[:, kq], run.middle.q[:, kq], 0.02 * travel)
    column = propagate(run, [Sensitivity.on(kv, law[1], law[0])])[:, :, 0]
    left = found.left(column.reshape(-1, 1))[:, 0]
    noise = np.random.default_rng(7).standard_normal(column.shape) * run.used
    moved = noise + there * 12.0 * column / np.sqrt(left @ left)
    with_noise = replace(found, run=replace(run, innovations=moved))
    (test,) = memory(with_noise, [f"encoder.joint_position[{joint}]", "bus"])
    assert test.where == f"torque of {joint}"
    assert (test.ratio > 60.0) == there
    assert (test.p_value < 1e-6) == there
    assert not memory(with_noise, ["bus"])
