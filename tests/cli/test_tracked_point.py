"""The tracked point P from the command line: stated, or unknown and found from Exp. 2."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from identify.support import from_twin, noisy, paper
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.errors import SmsidError
from smsid.identify.estimate import Estimate, load_estimate
from smsid.paths import urdf_folder
from smsid.recording import save_recording

P = np.array([0.5, 1.5, 0.6])
DESCRIPTION = str(urdf_folder() / "paper_sms.toml")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Exp. 2 in MuJoCo with the reference sensors' noise."""
    from twins.mujoco_twin import Drive, MujocoTwin
    from twins.recordings import Q0_ARM
    from twins.state import State

    def wheels(t: float) -> np.ndarray:
        return 2.0 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.05]) * t + np.arange(3)) * min(t, 1.0)

    def arm(t: float) -> np.ndarray:
        swing = np.sin(2 * np.pi * np.array([0.1, 0.13, 0.17]) * t + np.arange(3))
        return np.array([20.0, 25.0, 10.0]) * swing * min(t, 1.0)

    drive = Drive(wheel_torque=wheels, joint_torque=arm)
    channels = MujocoTwin().simulate(drive, 40.0, initial=State(q=Q0_ARM.copy()), dt=1e-2)
    path = tmp_path_factory.mktemp("flight") / "exp2.nc"
    save_recording(noisy(from_twin(channels), paper(), 0), path)
    return path


def identified(flight: Path, folder: Path, *options: str) -> Estimate:
    out = folder / "estimate.json"
    done = CliRunner().invoke(app, ["identify", DESCRIPTION, str(flight), "-o", str(out), *options])
    assert done.exit_code == 0, done.output or done.exception
    return load_estimate(out)


def test_a_stated_point_that_is_wrong_is_found_back(flight: Path, tmp_path: Path):
    """Stated 4 cm off, taken for unknown: r_p/b comes back within its interval."""
    found = identified(
        flight, tmp_path, "--method", "paper", "--tracked-point", "0.53,1.48,0.62", "--find-tracked-point"
    )
    for k, axis in enumerate("xyz"):
        p = found[f"pose_point.{axis}"]
        assert p.nominal == pytest.approx((0.53, 1.48, 0.62)[k])
        assert abs(p.value - P[k]) < 4.0 * p.sigma
        assert p.sigma < 0.01


def test_the_printed_modal_estimator_is_there(flight: Path, tmp_path: Path):
    plain = identified(flight, tmp_path, "--method", "paper")
    printed = identified(flight, tmp_path, "--method", "paper", "--modal", "printed")
    assert plain["system_cm.x"].value != printed["system_cm.x"].value


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--tracked-point", "1,2"), "no point"),
        (("--tracked-point", "1,2,nan"), "not finite"),
        (("--method", "paper", "--modal", "x"), "'x' is not one of 'smoother', 'printed'"),
        (("--find-tracked-point",), "--find-tracked-point is for the paper's method"),
        (("--modal", "printed"), "--modal is for the paper's method"),
    ],
)
def test_bad_options_are_told(flight: Path, tmp_path: Path, options: tuple[str, ...], said: str):
    arguments = ["identify", DESCRIPTION, str(flight), "-o", str(tmp_path / "e.json"), *options]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code != 0
    assert said in (str(done.exception) if isinstance(done.exception, SmsidError) else done.output)
