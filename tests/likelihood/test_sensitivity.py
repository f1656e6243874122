"""Every analytic derivative of the outputs against central differences of the outputs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.likelihood.outputs import Kinematics
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.piece import Local, Nuisance, Piece, piece_of

from . import twin


@pytest.fixture(scope="module", params=["exp1", "exp2"])
def case(request: pytest.FixtureRequest) -> tuple[Piece, Local, Parameters]:
    clean = twin.exp1((1, 1, 1), 9.0) if request.param == "exp1" else twin.exp2(6.0)
    nuisance = Nuisance(thrust_gain=0.01, scale={"imu.acceleration": 0.01})
    piece, local = piece_of(twin.model(), clean, nuisance, described_noise=True)
    parameters = Parameters.of(twin.model())
    rng = np.random.default_rng(1)
    # away from the description, where symmetric zeros would hide mistakes
    step = 0.03 * rng.standard_normal(parameters.size)
    return piece, piece.moved(local, 0.01 * rng.standard_normal(piece.size)), parameters.moved(step)


def outputs(piece: Piece, parameters: Parameters, local: Local) -> list[np.ndarray]:
    """Residuals at the samples, sign changed, attitude as rotation vector from the measured one."""
    return [-r for r in piece.residuals(parameters, local, piece.predict(parameters, local))]


def test_jacobian_of_every_channel(case: tuple[Piece, Local, Parameters]):
    piece, local, parameters = case
    prediction = piece.predict(parameters, local)
    columns = list(piece.columns(parameters, local, prediction))
    size = parameters.size
    h = 1e-5
    rng = np.random.default_rng(2)
    for i in range(size + piece.size):
        step = h * np.eye(size + piece.size)[i]
        pair = [
            outputs(piece, parameters.moved(s * step[:size]), piece.moved(local, s * step[size:]))
            for s in (1.0, -1.0)
        ]
        for c, own, up, down in zip(piece.channels, columns, *pair, strict=True):
            chosen = rng.choice(len(c.times), 200, replace=False)
            if c.quantity == "attitude":
                # rotation vectors from the measured attitude are small but not zero: compare predictions
                difference = attitude_difference(piece, parameters, local, step, size)[chosen] / (2 * h)
            else:
                difference = (up - down)[chosen] / (2 * h)
            found = (c.weights @ own[:, :, i])[chosen]
            scale = max(np.abs(difference).max(), 1e-3 * np.abs(up).max() + 1e-9)
            # rounding of the difference and the interpolation's error bound it
            np.testing.assert_allclose(found, difference, atol=2e-5 * scale, err_msg=f"{c.name} by {i}")


def attitude_difference(
    piece: Piece, parameters: Parameters, local: Local, step: np.ndarray, size: int
) -> np.ndarray:
    turns = []
    for s in (1.0, -1.0):
        p, own = parameters.moved(s * step[:size]), piece.moved(local, s * step[size:])
        kinematics = Kinematics.of(twin.model(), piece.predict(p, own))
        c = next(c for c in piece.channels if c.quantity == "attitude")
        turns.append(Rotation.from_quat(c.weights @ kinematics.output(c.sensor, "attitude")))
    return (turns[1].inv() * turns[0]).as_rotvec()
