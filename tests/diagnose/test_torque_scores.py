"""Couplings of joints: what both joints feel alike, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.diagnose import diagnose

from .torque_world import described, recorded


@pytest.mark.parametrize("seed", [6, 18, 31, 44, 45, 52])
def test_what_one_joint_feels_of_another_is_no_coupling(seed):
    """A motor that turns with two joints is felt by both alike; asked for its sign alone, these were."""

    def hidden(q, v, a, load):
        return np.column_stack([np.zeros(len(v)), 6.0 * v[:, 2], np.zeros(len(v))])

    found = diagnose(described(), [recorded(hidden, seed=seed)], cutoff=20.0).diagnosis
    assert not any(c.effect.startswith("motor_coupling") for c in found.causes), found.sentence
