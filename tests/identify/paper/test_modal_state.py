"""Modal states from panel accelerometers against the truth of another engine: smoother, and (31)-(32)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from twins.description import write_description
from twins.mujoco_twin import Drive, MujocoTwin
from twins.numbers import PAPER
from twins.recordings import Q0_ARM
from twins.state import State

from smsid.description import load_description
from smsid.errors import NotIdentifiableError
from smsid.identify.modes import identified_modes
from smsid.identify.paper.hidden_states import hidden_states
from smsid.identify.paper.modal_state import ModalState, integrate_accelerometers, smooth_modes
from smsid.identify.paper.motion import prepare
from smsid.model import build_model
from smsid.sensing import Sensor

from ..support import from_twin, noisy, oracle, paper, reference


def errors(found: ModalState, recording, motion, part=slice(None)) -> np.ndarray:
    """RMS error of each modal coordinate, then of each rate, relative to its RMS, (2 modes,)."""
    at = np.searchsorted(recording.time(), motion.time)
    out = []
    for mine, name in ((found.position, "position"), (found.velocity, "velocity")):
        true = recording[f"truth.modal_{name}"][at]
        out.append(np.sqrt(np.mean((mine - true)[part] ** 2, axis=0) / np.mean(true**2, axis=0)))
    return np.concatenate(out)


def smoothed(model, motion, noise: float = 1e-9) -> ModalState:
    return smooth_modes(motion, model.appendages[0], accelerometer=noise, imu=noise)


def test_smoother_on_the_twin(model, twin_flight):
    """Rates of 0.08 rad/s; what is left is the derivative of the body rate, 1e-4 at the most."""
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    assert errors(smoothed(model, motion), twin_flight, motion).max() < 2e-4


def test_smoother_needs_its_gyroscopic_terms(model, twin_flight):
    """Without the centripetal acceleration of root and modal mass the error is a hundred times as large."""
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    blind = replace(motion, rate=np.zeros_like(motion.rate))
    assert errors(smoothed(model, blind), twin_flight, motion).max() > 0.01


def test_without_accelerometers_the_modes_follow_the_base(model, twin_flight):
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    unseen = replace(motion, panels={}, stations={})
    found = hidden_states(model, unseen).modes["panel"]
    assert errors(found, twin_flight, motion).max() < 5e-4


def test_accelerometers_mend_a_wrong_frequency(model, twin_flight):
    """Frequencies 5 % too high: the base alone leads astray, the accelerometers lead back."""
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    joints = model.appendages[0]
    part = joints.appendage
    modes = [m.model_copy(update={"frequency": 1.05 * m.frequency}) for m in part.modal_data()]
    wrong = replace(
        joints, appendage=identified_modes(part, 1.0, ()).model_copy(update={"mode": tuple(modes)})
    )
    seen = smooth_modes(motion, wrong, accelerometer=1e-6, imu=1e-3)
    blind = smooth_modes(replace(motion, panels={}, stations={}), wrong, accelerometer=1e-6, imu=1e-3)
    first = [errors(x, twin_flight, motion)[0] for x in (seen, blind)]
    assert first[0] < 0.5 * first[1]


def test_printed_integration_is_of_first_order(model, twin_flight):
    """(31)-(32) without noise: rectangles err by the step; five times coarser, five times worse."""
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    fine = errors(integrate_accelerometers(motion, model.appendages[0]), twin_flight, motion)
    thin = motion.thinned(5)
    coarse = errors(integrate_accelerometers(thin, model.appendages[0]), twin_flight, thin)
    assert fine[0] < 0.01 and fine.max() < 0.06
    np.testing.assert_allclose(coarse / fine, 5.0, rtol=0.25)


@oracle
def test_smoother_on_the_reference_recording(model):
    """The recording's panel is strips, up to 2e-3 from the beam's modes.

    Filtered at 2 Hz the rate of mode 3, 0.8 Hz and struck at the start, errs by 4e-3.
    """
    recording = reference("exp2_modal3")
    motion = prepare(model, recording, cutoff=None, rate=None)
    assert errors(smoothed(model, motion), recording, motion).max() < 2e-3
    motion = prepare(model, recording)
    assert errors(smoothed(model, motion), recording, motion).max() < 1e-2


@oracle
def test_noise_makes_the_printed_integration_drift(model):
    """1e-4 m/s2 on panel and IMU. The smoother stays within 1 %; double integration runs away."""
    recording = reference("exp2_modal3")
    motion = prepare(model, noisy(recording, paper(), 0))
    joints = model.appendages[0]
    assert errors(smoothed(model, motion, 3e-5), recording, motion).max() < 0.01
    printed = integrate_accelerometers(motion, joints)
    quarter = len(motion) // 4
    late = errors(printed, recording, motion, slice(-quarter, None))
    early = errors(printed, recording, motion, slice(0, quarter))
    assert (late[:3] > 2.0 * early[:3]).all()
    assert late[2] > 1.0  # the third mode, a hundredth of the first, is lost


def test_too_few_accelerometer_axes_are_told(model, twin_flight):
    motion = prepare(model, twin_flight, cutoff=None, rate=None)
    two = replace(
        motion,
        panels={"panel": motion.panels["panel"][:, :2]},
        stations={"panel": motion.stations["panel"][:2]},
    )
    with pytest.raises(NotIdentifiableError, match="2 accelerometer axes see the 3 modes of 'panel'"):
        integrate_accelerometers(two, model.appendages[0])


@pytest.fixture(scope="module", params=["beam", "modal"])
def turned(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    """The spacecraft described in axes turned against the twin's, so the panel sits in a turned frame."""
    turn = Rotation.from_euler("xyz", [0.4, -0.7, 1.1])
    path = write_description(PAPER, tmp_path_factory.mktemp("turned"))
    described = load_description(path)
    panel = described.get_effect("panel")
    root = turn.apply(PAPER.panel_root)
    # bus axes = turned twin axes: mounting rpy is that of the turn, about fixed axes
    placed = panel.model_copy(update={"position": tuple(root), "rpy": tuple(turn.as_euler("xyz"))})
    if request.param == "modal":
        placed = identified_modes(placed, 1.0, ())
    sensors = (
        Sensor(name="pose", kind="pose", rate=100.0, position=tuple(turn.apply(PAPER.point))),
        Sensor(name="imu", kind="imu", rate=100.0, position=tuple(turn.apply(PAPER.point))),
        Sensor(name="encoder", kind="encoder", rate=100.0),
        Sensor(name="tachometer", kind="tachometer", rate=100.0),
        Sensor(name="panel", kind="accelerometers", rate=100.0, appendage="panel"),
    )
    return build_model(described.with_effects(placed).with_sensors(*sensors)), turn


def test_panel_in_a_turned_frame(turned):
    """The same motion told in turned body axes: the same modal states, as a beam and as modal data."""
    model, turn = turned
    drive = Drive(wheel_torque=lambda t: np.array([2.0, -1.5, 1.0]) * np.sin(0.5 * t))
    start = State(q=Q0_ARM.copy(), omega_b=np.array([0.03, -0.02, 0.04]))
    channels = MujocoTwin().simulate(drive, 15.0, initial=start, dt=1e-2)
    for name in ("acc_imu_body", "omega_body", "panel_acc_base"):
        channels[name] = channels[name] @ turn.as_matrix().T
    quaternion = channels["quat_wxyz"]
    attitude = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]) * turn.inv()
    channels["quat_wxyz"] = attitude.as_quat()[:, [3, 0, 1, 2]]
    recording = from_twin(channels)
    motion = prepare(model, recording, cutoff=None, rate=None)
    assert errors(smoothed(model, motion), recording, motion).max() < 2e-3
    found = integrate_accelerometers(motion, model.appendages[0])
    assert errors(found, recording, motion)[0] < 0.02
