"""An arm that stands up against gravity: its errors grow by themselves, and the filter must not lose it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.description import load_description
from smsid.diagnose import diagnose
from smsid.model import build_model
from smsid.recording import Recording
from tests.hidden.description import write_description
from tests.hidden.numbers import JOINTS, WORLDS


def test_an_arm_that_stands_is_followed(tmp_path):
    described = load_description(
        write_description(replace(WORLDS["arm"], gravity=(-9.81, 0.0, 0.0)), tmp_path)
    )
    model, rng = build_model(described), np.random.default_rng(0)
    t = np.arange(0.0, 20.0, 0.02)
    q, v, a = np.zeros((3, len(t), 3))
    for j in range(3):
        for w in 2.0 * np.pi * np.array([0.05, 0.13, 0.31]):
            phase = w * t + rng.uniform(0.0, 6.0)
            q[:, j] += 0.15 * np.sin(phase)
            v[:, j] += 0.15 * w * np.cos(phase)
            a[:, j] -= 0.15 * w**2 * np.sin(phase)
    data = model.pin.createData()
    torque = np.array([pin.rnea(model.pin, data, *x) for x in zip(q, v, a, strict=True)])
    recording = Recording.from_arrays(
        t,
        {
            "encoder.joint_position": q + 1e-5 * rng.standard_normal(q.shape),
            "encoder.joint_velocity": v + 1e-4 * rng.standard_normal(v.shape),
            "command.joint_torque": torque,
        },
        labels={"joint": list(JOINTS)},
        provenance={"inputs": "linear", "acceleration": "limit from the left"},
        role="estimation",
        name="standing",
    )
    assert diagnose(described, [recording]).diagnosis.verdict == "adequate"
