"""A mode that an effect adds to a beam: the bus is the described one, and density moves all modes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from smsid.description import load_description
from smsid.effects import BeamMode
from smsid.likelihood.parameters import Parameters
from smsid.model import build_model


def test_a_beam_with_a_mode_more_has_the_same_bus(urdf: Path) -> None:
    description = load_description(urdf / "paper_sms.toml")
    more = BeamMode(name="more", appendage="panel", mode=4)
    plain = Parameters.of(build_model(description))
    model = build_model(description.with_effects(more))
    found = Parameters.of(model)
    assert found.names == plain.names
    assert found.layout.unseen == plain.layout.unseen
    np.testing.assert_allclose(found.inertias, plain.inertias, rtol=1e-9, atol=1e-9)

    row = list(model.spring_v).index(model.pin.joints[model.pin.getJointId("more")].idx_v)
    stiffness, damping, dk, dd = found.springs()
    assert stiffness[row] == pytest.approx(model.stiffness[row])
    at = found.index("panel.density_factor")
    step = np.zeros(found.size)
    step[at] = 1e-6
    up, up_damping, _, _ = found.moved(step).springs()
    assert dk[row, at] == pytest.approx((up[row] - stiffness[row]) / 1e-6, rel=1e-4)
    heavier = found.moved(step * 1e5)
    bodies = np.concatenate([i.toDynamicParameters() for i in list(heavier.pin_model().inertias)[1:]])
    masses = [theta.reshape(-1, 10)[:, 0].sum() for theta in (bodies, heavier.theta())]
    assert masses[0] == pytest.approx(masses[1], rel=1e-12)
    assert dd[row, at] == pytest.approx((up_damping[row] - damping[row]) / 1e-6, rel=1e-4)
