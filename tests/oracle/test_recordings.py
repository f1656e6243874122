"""The model against recordings of an independent engine (MuJoCo, strip-discretised linear panel)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from smsid.description import load_description
from smsid.experiments import thrust_experiment
from smsid.model import SpacecraftModel, build_model
from smsid.recording import Recording, import_recording
from smsid.simulate import Fourier, Inputs, simulate, truth_of

# the recordings' own strip discretisation is 1-2e-3 of a channel's maximum
TOLERANCE = 2.5e-3
# after a step of an input, the recordings' pinned higher panel modes (40 Hz, damping 0.7) ring
RINGING = 0.05  # [s]


@pytest.fixture(scope="module")
def model(urdf: Path) -> SpacecraftModel:
    return build_model(load_description(urdf / "paper_sms.toml"))


def fourier(time: np.ndarray, torque: np.ndarray) -> Fourier:
    """Fit the series the torques were made of: fundamental 1/40 Hz, five harmonics."""
    phase = 2 * np.pi * np.outer(time, np.arange(1, 6)) / 40
    design = np.column_stack([np.ones(len(time)), np.cos(phase), np.sin(phase)])
    found, *_ = np.linalg.lstsq(design, torque, rcond=None)
    assert np.abs(design @ found - torque).max() < 1e-5 * np.abs(torque).max()
    return Fourier(1 / 40, found[1:6].T, found[6:].T, found[0])


def differences(
    model: SpacecraftModel, recording: Recording, inputs: Inputs, steps: list[float]
) -> dict[str, float]:
    """Largest difference of each channel, relative to the largest magnitude of the whole channel."""
    time = recording.time()
    trajectory = simulate(model, inputs, float(time[-1]))
    ours = truth_of(trajectory, model.description.sensor)(time)
    calm = np.ones(len(time), dtype=bool)
    for step in steps:
        calm &= ~((time >= step) & (time < step + RINGING))
    found = {}
    for name in recording.channels:
        if name not in ours:
            continue
        theirs, mine = recording[name], ours[name]
        if name.endswith("attitude"):
            mine = mine * np.sign(np.sum(mine * theirs, axis=1))[:, None]
        accelerations = name.endswith("acceleration") or name == "command.torque"
        chosen = calm if accelerations else slice(None)
        scale = np.abs(theirs).max()
        if scale > 1e-9:
            found[name] = float(np.abs(mine - theirs)[chosen].max() / scale)
    return found


@pytest.mark.parametrize(("name", "axes"), [("exp1_z_modal3", "z"), ("exp1_xyz_modal3", "xyz")])
def test_experiment_1_agrees_with_the_recording(
    model: SpacecraftModel, oracle: Path, name: str, axes: str
) -> None:
    recording = import_recording(oracle / f"{name}.npz", "oracle_exp1")
    found = differences(model, recording, thrust_experiment(axes).inputs(), [0.0, 20.0, 40.0])
    assert {"imu.acceleration", "panel.acceleration", "truth.slosh_position", "command.torque"} <= set(found)
    assert max(found.values()) < TOLERANCE, found


@pytest.mark.parametrize("name", ["exp2_modal3", "exp2val_modal3"])
def test_experiment_2_agrees_with_the_recording(model: SpacecraftModel, oracle: Path, name: str) -> None:
    recording = import_recording(oracle / f"{name}.npz", "oracle_exp2")
    time = recording.time()
    inputs = Inputs(
        wheel_torque=fourier(time, recording["command.wheel_torque"]),
        joint_torque=fourier(time, recording["command.joint_torque"]),
    )
    found = differences(model, recording, inputs, [0.0])
    assert {"imu.acceleration", "imu.angular_rate", "panel.acceleration", "encoder.joint_velocity"} <= set(
        found
    )
    assert max(found.values()) < TOLERANCE, found
