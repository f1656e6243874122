"""Every analytic derivative of the outputs against central differences of the outputs."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.likelihood.jacobian import columns, normal
from smsid.likelihood.nuisance_parameters import Nuisance, NuisanceValues
from smsid.likelihood.outputs import Kinematics
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.recording_term import RecordingTerm, piece_of

from . import twin


@pytest.fixture(scope="module", params=["exp1", "exp2"])
def case(request: pytest.FixtureRequest) -> tuple[RecordingTerm, NuisanceValues, Parameters]:
    clean = twin.exp1((1, 1, 1), 9.0) if request.param == "exp1" else twin.exp2(6.0)
    nuisance = Nuisance(thrust_gain=0.01, scale={"imu.acceleration": 0.01})
    piece, local = piece_of(twin.model(), clean, nuisance, described_noise=True)
    piece = piece.following()
    parameters = Parameters.of(twin.model())
    rng = np.random.default_rng(1)
    # away from the description, where symmetric zeros would hide mistakes
    step = 0.03 * rng.standard_normal(parameters.size)
    shift = 0.01 * rng.standard_normal(piece.size)
    return piece, piece.moved(local, shift * scales(piece)), parameters.moved(step)


def scales(piece: RecordingTerm) -> np.ndarray:
    """One, but for the joints' motion, which stays a smooth one."""
    out = np.ones(piece.size)
    for s in piece.slots:
        if s.kind == "joint_motion":
            out[s.start : s.start + s.size] = 0.01
    return out


def outputs(piece: RecordingTerm, parameters: Parameters, local: NuisanceValues) -> list[np.ndarray]:
    """Residuals at the samples, sign changed, attitude as rotation vector from the measured one."""
    return [-r for r in piece.residuals(parameters, local, piece.predict(parameters, local))]


def test_jacobian_of_every_channel(case: tuple[RecordingTerm, NuisanceValues, Parameters]):
    piece, local, parameters = case
    prediction = piece.predict(parameters, local)
    found_columns = columns(piece, parameters, local, prediction)
    size = parameters.size
    h = 1e-5
    rng = np.random.default_rng(2)
    chosen_columns = list(range(size + piece.size))
    for s in piece.slots:
        if s.kind == "joint_motion":
            inside = range(size + s.start, size + s.start + s.size)
            few = {inside[0], inside[-1], *rng.choice(inside, 20, replace=False).tolist()}
            chosen_columns = [i for i in chosen_columns if i not in inside or i in few]
    for i in chosen_columns:
        step = h * np.eye(size + piece.size)[i]
        pair = [
            outputs(piece, parameters.moved(s * step[:size]), piece.moved(local, s * step[size:]))
            for s in (1.0, -1.0)
        ]
        for c, own, up, down in zip(piece.channels, found_columns, *pair, strict=True):
            chosen = rng.choice(len(c.times), 200, replace=False)
            if c.quantity == "attitude":
                # rotation vectors from the measured attitude are small but not zero: compare predictions
                difference = attitude_difference(piece, parameters, local, step, size)[chosen] / (2 * h)
            else:
                difference = (up - down)[chosen] / (2 * h)
            found = (c.coarse_weights @ own[:, :, i])[chosen]
            scale = max(np.abs(difference).max(), 1e-3 * np.abs(up).max() + 1e-9)
            # derivatives are carried on steps of 0.6 rad of the fastest mode: their phase drifts a little
            np.testing.assert_allclose(found, difference, atol=1e-3 * scale, err_msg=f"{c.name} by {i}")


def attitude_difference(
    piece: RecordingTerm, parameters: Parameters, local: NuisanceValues, step: np.ndarray, size: int
) -> np.ndarray:
    turns = []
    for s in (1.0, -1.0):
        p, own = parameters.moved(s * step[:size]), piece.moved(local, s * step[size:])
        kinematics = Kinematics.of(twin.model(), piece.predict(p, own))
        c = next(c for c in piece.channels if c.quantity == "attitude")
        turns.append(Rotation.from_quat(c.weights @ kinematics.output(c.sensor, "attitude")))
    return (turns[1].inv() * turns[0]).as_rotvec()


def test_cheaper_than_differences(case: tuple[RecordingTerm, NuisanceValues, Parameters]):
    """All derivatives take less than a tenth of the time that central differences would."""
    piece, local, parameters = case
    prediction = piece.predict(parameters, local)
    begin = time.process_time()
    normal(piece, parameters, local, prediction, piece.residuals(parameters, local, prediction))
    analytic = time.process_time() - begin
    begin = time.process_time()
    for _ in range(5):
        outputs(piece, parameters, local)
    once = (time.process_time() - begin) / 5
    assert analytic < 0.1 * 2 * (parameters.size + piece.size) * once
