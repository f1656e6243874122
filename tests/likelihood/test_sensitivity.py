"""Every analytic derivative of the outputs against central differences of the outputs."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.likelihood._outputs import Kinematics
from smsid.likelihood.jacobian import columns, normal
from smsid.likelihood.nuisance_parameters import Nuisance, NuisanceValues
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
    motion = 1e-4 * rng.standard_normal(local.motion.shape)  # it stays a smooth one
    return piece, piece.moved(replace(local, motion=local.motion + motion), shift), parameters.moved(step)


def moved(
    piece: RecordingTerm, parameters: Parameters, local: NuisanceValues, step: np.ndarray
) -> tuple[Parameters, NuisanceValues]:
    """What a step in (parameters, local ones, coefficients of the joints' motion) leads to."""
    size, whole = parameters.size, parameters.size + piece.size
    changed = local.motion + step[whole:].reshape(local.motion.shape) if piece.follows else local.motion
    return parameters.moved(step[:size]), piece.moved(replace(local, motion=changed), step[size:whole])


def outputs(piece: RecordingTerm, parameters: Parameters, local: NuisanceValues) -> list[np.ndarray]:
    """Residuals at the samples, sign changed, attitude as rotation vector from the measured one."""
    return [-r for r in piece.residuals(parameters, local, piece.predict(parameters, local))]


def test_jacobian_of_every_channel(case: tuple[RecordingTerm, NuisanceValues, Parameters]):
    piece, local, parameters = case
    prediction = piece.predict(parameters, local)
    found_columns = columns(piece, parameters, local, prediction)
    h = 1e-5
    rng = np.random.default_rng(2)
    whole, motion = parameters.size + piece.size, local.motion.size if piece.follows else 0
    chosen_columns = list(range(whole))
    if motion:
        ends = {whole, whole + motion - 1}
        chosen_columns += sorted(ends | {whole + int(i) for i in rng.choice(motion, 20, replace=False)})
    for i in chosen_columns:
        step = h * np.eye(whole + motion)[i]
        pair = [outputs(piece, *moved(piece, parameters, local, s * step)) for s in (1.0, -1.0)]
        for c, own, up, down in zip(piece.channels, found_columns, *pair, strict=True):
            chosen = rng.choice(len(c.times), 200, replace=False)
            if c.quantity == "attitude":
                # rotation vectors from the measured attitude are small but not zero: compare predictions
                difference = attitude_difference(piece, parameters, local, step)[chosen] / (2 * h)
            else:
                difference = (up - down)[chosen] / (2 * h)
            found = (c.coarse_weights @ own[:, :, i])[chosen]
            scale = max(np.abs(difference).max(), 1e-3 * np.abs(up).max() + 1e-9)
            # derivatives are carried on steps of 0.6 rad of the fastest mode: their phase drifts a little
            np.testing.assert_allclose(found, difference, atol=1e-3 * scale, err_msg=f"{c.name} by {i}")


def attitude_difference(
    piece: RecordingTerm, parameters: Parameters, local: NuisanceValues, step: np.ndarray
) -> np.ndarray:
    turns = []
    for s in (1.0, -1.0):
        p, own = moved(piece, parameters, local, s * step)
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
    assert analytic < 0.1 * 2 * (parameters.size + piece.size + local.motion.size) * once
