"""Wheels that follow their measured motion beside commands held at 5 Hz: a satellite by its own equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.errors import SmsidError
from smsid.estimation.identify_flights import identify_flights
from smsid.recording import Recording, import_recording
from tests.cube_satellite import AXES, WHEEL, cube

BODY = np.array([[0.352, 0.011, -0.006], [0.011, 0.418, 0.009], [-0.006, 0.009, 0.287]])  # with the wheels
RATE, SECONDS = 5, 100
MAPPING = """
[recording]
{said}
[time]
column = "t"
unit = "s"
[channel."tracker.attitude"]
columns = ["qx", "qy", "qz", "qw"]
quaternion = "xyzw"
direction = "body_to_inertial"
[channel."gyro.angular_rate"]
columns = ["wx", "wy", "wz"]
unit = "rad/s"
frame = "body"
[channel."tachometer.wheel_rate"]
columns = ["o0", "o1", "o2", "o3"]
unit = "rad/s"
[channel."command.wheel_torque"]
columns = ["u0", "u1", "u2", "u3"]
unit = "N m"
"""


def flown(seed: int) -> np.ndarray:
    """Stamps, quaternion, rates, wheels' rates and held torques (N, 16), as measured."""
    rng = np.random.default_rng(seed)
    n = SECONDS * RATE + 1
    t = np.arange(n) / RATE
    torques = np.zeros((n, 4))
    for w in range(4):
        for k in range(1, 7):
            size, phase = 4e-4 * rng.normal(), rng.uniform(0, 6.28)
            torques[:, w] += size * np.sin(2 * np.pi * k * t / 60 + phase)
    inverse = np.linalg.inv(BODY - WHEEL * AXES @ AXES.T)

    def slope(w: np.ndarray, spin: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        momentum = BODY @ w + WHEEL * AXES @ spin
        turn = inverse @ (-np.cross(w, momentum) - AXES @ u)
        return turn, u / WHEEL - AXES.T @ turn

    turned = Rotation.from_euler("xyz", [0.3, -0.4, 1.0])
    w, spin, h = np.array([0.01, -0.02, 0.015]), np.array([100.0, -50.0, 80.0, 20.0]), 1.0 / RATE / 40
    rows = []
    for u in torques:
        rows.append(np.r_[turned.as_quat(), w, spin])
        for _ in range(40):  # midpoint: errors of h^2, 1e-9 rad a sample
            a, b = slope(w, spin, u)
            middle = w + 0.5 * h * a
            a, b = slope(middle, spin + 0.5 * h * b, u)
            turned, w, spin = turned * Rotation.from_rotvec(h * middle), w + h * a, spin + h * b
    x, rng = np.array(rows), np.random.default_rng(1000 + seed)
    noisy = Rotation.from_quat(x[:, :4]) * Rotation.from_rotvec(5e-5 * rng.normal(size=(n, 3)))
    rates = x[:, 4:7] + 1e-4 * rng.normal(size=(n, 3)) + [2e-4, -1e-4, 3e-4]
    return np.c_[t, noisy.as_quat(), rates, x[:, 7:] + 0.1 * rng.normal(size=(n, 4)), torques]


def recorded(tmp_path, seed: int, said: str = "") -> Recording:
    columns = ["t", *(f"q{c}" for c in "xyzw"), *(f"w{c}" for c in "xyz")]
    columns += [f"o{k}" for k in range(4)] + [f"u{k}" for k in range(4)]
    np.savetxt(tmp_path / "log.csv", flown(seed), delimiter=",", header=",".join(columns), comments="")
    (tmp_path / "map.toml").write_text(MAPPING.format(said=said))
    return import_recording(tmp_path / "log.csv", tmp_path / "map.toml")


@pytest.mark.parametrize(("seed", "said"), [(26, ""), (26, 'inputs = "held"')], ids=["not told", "told"])
def test_inertias_hold_whether_or_not_it_is_told_that_torques_are_held(tmp_path, seed, said):
    """Straight lines between samples make a rotation of 10 s 1e-3 larger; alone, that is 4 sigmas."""
    guess = cube(tmp_path, (0.3, 0.36, 0.33))  # 15 % off
    found = identify_flights(guess, [recorded(tmp_path, seed, said)]).estimate
    for name, i in (("bus.Icxx", 0), ("bus.Icyy", 1), ("bus.Iczz", 2)):
        p = found[name]
        assert abs(p.value - BODY[i, i]) < 2.5 * p.sigma, (name, p)
        assert p.sigma < 4e-4 * BODY[i, i]
    assert any("nothing tells how commands go on" in n for n in found.notes) == (not said)


def test_a_mapping_says_how_commands_act(tmp_path):
    assert recorded(tmp_path, 1, 'inputs = "linear"').provenance["inputs"] == "linear"
    with pytest.raises(SmsidError, match="inputs"):
        recorded(tmp_path, 1, 'inputs = "sometimes"')
