"""Names of columns say in which order components are, whatever the order of the file."""

from __future__ import annotations

import itertools
import logging
import tomllib

import numpy as np
import pytest

from smsid.recording import import_recording
from smsid.recording._name_order import name_tokens, sorted_by_name
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import parse_mapping

N = 60


def _log(path, names, seed=0):
    """Write columns whose samples are told by their names alone: what is imported can be compared."""
    t = 0.1 * np.arange(N)
    signals = {n: np.random.default_rng([seed, *n.encode()]).normal(size=N) for n in names}
    lines = [",".join(["t", *names])]
    lines += [",".join(map(str, [x, *(signals[n][k] for n in names)])) for k, x in enumerate(t)]
    path.write_text("\n".join(lines))
    return signals


CASES = [
    ("position", ("pos_x [m]", "pos_y [m]", "pos_z [m]"), None),
    ("angular_rate", ("gyro_X_degs", "gyro_Y_degs", "gyro_Z_degs"), None),
    ("angular_rate", ("roll_rate [deg/s]", "pitch_rate [deg/s]", "yaw_rate [deg/s]"), None),
    ("acceleration", ("acc1", "acc2", "acc3"), None),
    ("joint_position", ("q8_deg", "q9_deg", "q10_deg"), None),
    (
        "joint_position",
        ("joint1_position", "joint2_position", "joint3_position"),
        ("joint1", "joint2", "joint3"),
    ),
    ("joint_position", ("J1_position_rad", "J2_position_rad", "J3_position_rad"), ("J1", "J2", "J3")),
]


@pytest.mark.parametrize(("quantity", "names", "labels"), CASES)
def test_a_draft_orders_components_by_their_names(tmp_path, quantity, names, labels):
    for order in itertools.permutations(names):
        _log(tmp_path / "log.csv", order)
        table = tomllib.loads(inspect_file(tmp_path / "log.csv").mapping)["channel"][f"log.{quantity}"]
        assert table["columns"] == list(names)
        assert tuple(table.get("labels", ())) == (labels or ())


def test_numbered_quaternions_begin_with_number_zero(tmp_path):
    q = np.random.default_rng(1).normal(size=(N, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    rows = [f"{0.1 * k},{b},{d},{a},{c}" for k, (a, b, c, d) in enumerate(q)]
    (tmp_path / "log.csv").write_text("\n".join(["t,q1,q3,q0,q2", *rows]))
    text = inspect_file(tmp_path / "log.csv").mapping
    table = tomllib.loads(text)["channel"]["log.attitude"]
    assert table["columns"] == ["q0", "q1", "q2", "q3"] and table["quaternion"] == "wxyz"
    assert "guess: the names do not say" in text


def test_joints_by_two_names_are_told_apart_by_their_numbers(tmp_path):
    _log(tmp_path / "log.csv", ("joint2_position", "joint1_position", "motor2_torque", "motor1_torque"))
    channels = tomllib.loads(inspect_file(tmp_path / "log.csv").mapping)["channel"]
    assert channels["log.joint_position"]["columns"] == ["joint1_position", "joint2_position"]
    assert channels["log.joint_torque"]["columns"] == ["motor1_torque", "motor2_torque"]
    assert not any("labels" in table for table in channels.values())


@pytest.mark.parametrize(
    ("names", "tokens"),
    [
        (("x", "y", "z"), ("x", "y", "z")),
        (("max_y", "max_x", "max_z"), ("y", "x", "z")),
        (("j10", "j9"), ("10", "9")),
        (("arm_2_q1", "arm_2_q3"), ("1", "3")),
        (("torso", "arm_1"), None),
        (("x1", "y2", "z3"), None),
        (("q1", "q01"), None),
        (("x",), None),
    ],
)
def test_what_names_differ_in(names, tokens):
    assert name_tokens(names) == tokens
    assert sorted_by_name(sorted_by_name(names)) == sorted_by_name(names)


JOINTS = {"columns": ["j2", "j1"], "unit": "rad"}
DOUBTED = [
    ("position", {"columns": ["pz", "px", "py"], "unit": "m"}, "say px, py, pz"),
    ("joint_position", JOINTS, "in the spacecraft's order; their names say j1, j2"),
    ("joint_position", JOINTS | {"labels": ["a1", "a2"]}, "labels j2, j1 as a1, a2"),
    (
        "attitude",
        {"columns": ["qw", "qx", "qy", "qz"], "quaternion": "xyzw", "direction": "body_to_inertial"},
        "takes qw, qx, qy, qz as x, y, z, w",
    ),
]  # fmt: skip
TRUSTED = [
    ("position", {"columns": ["px", "py", "pz"], "unit": "m"}),
    ("position", {"columns": ["py", "px", "pz"], "unit": "m", "sign": [1, 1, -1]}),
    ("joint_position", JOINTS | {"labels": ["a2", "a1"]}),
    ("joint_position", JOINTS | {"labels": ["elbow", "wrist"]}),
    (
        "attitude",
        {"columns": ["qw", "qx", "qy", "qz"], "quaternion": "wxyz", "direction": "body_to_inertial"},
    ),
]


def _import(tmp_path, quantity, table):
    _log(tmp_path / "log.csv", table["columns"])
    document = {"time": {"column": "t", "unit": "s"}, "channel": {f"s.{quantity}": table}}
    return import_recording(tmp_path / "log.csv", parse_mapping(document), check=False)


@pytest.mark.parametrize(("quantity", "table", "words"), DOUBTED)
def test_an_order_that_contradicts_the_names_is_doubted(tmp_path, caplog, quantity, table, words):
    with caplog.at_level(logging.WARNING):
        _import(tmp_path, quantity, table)
    assert words in caplog.text


@pytest.mark.parametrize(("quantity", "table"), TRUSTED)
def test_an_order_that_is_told_raises_no_doubt(tmp_path, caplog, quantity, table):
    with caplog.at_level(logging.WARNING):
        _import(tmp_path, quantity, table)
    assert not caplog.text
