"""Labels decide which column is which joint, wheel or station; in another order, nothing changes."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.description import load_description
from smsid.errors import RecordingError
from smsid.experiments import fly, named_experiment
from smsid.model import SpacecraftModel, build_model
from smsid.model.column_order import column_map, order_columns
from smsid.recording import Recording

URDF = Path(__file__).parents[2] / "urdf"
STATIONS = ("2 m", "4 m", "6 m")


@cache
def paper() -> SpacecraftModel:
    return build_model(load_description(URDF / "paper_sms.toml"))


@cache
def flight(name: str) -> Recording:
    return fly(paper(), named_experiment(name, paper()), np.random.default_rng(4)).recording


@cache
def flown(name: str, seconds: float) -> Recording:
    """An experiment's beginning, stations labelled by their distances."""
    whole = flight(name).window(0.0, seconds)
    channels = {n: (whole.time(n), whole[n]) for n in whole.channels}
    labels = {**whole.labels, "panel.station": STATIONS}
    return Recording.from_arrays(whole.time(), channels, labels=labels, role="estimation", name=name)


def permuted(recording: Recording, orders: dict[str, list[int]]) -> Recording:
    """The recording with columns and their labels in another order."""
    channels, labels = {}, dict(recording.labels)
    for name in recording.channels:
        values = recording[name]
        for axis, dim in enumerate(recording.channel(name).dims[1:], start=1):
            if dim in orders:
                values = np.take(values, orders[str(dim)], axis=axis)
        channels[name] = (recording.time(name), values)
    for key, order in orders.items():
        labels[key] = tuple(labels[key][k] for k in order)
    return Recording.from_arrays(
        recording.time(), channels, labels=labels, role=recording.role, name=recording.name
    )


def relabelled(recording: Recording, key: str, labels: tuple[str, ...]) -> Recording:
    channels = {n: (recording.time(n), recording[n]) for n in recording.channels}
    named = {**recording.labels, key: labels}
    return Recording.from_arrays(
        recording.time(), channels, labels=named, role=recording.role, name=recording.name
    )


TURNED = {"joint": [2, 0, 1], "wheel": [1, 2, 0], "panel.station": [2, 0, 1]}


@settings(deadline=None, max_examples=6)
@given(st.permutations(range(3)), st.permutations(range(3)), st.permutations(range(3)))
def test_any_order_comes_back_to_the_models(joints, wheels, stations):
    given_ = flown("exp2", 2.0)
    orders = {"joint": list(joints), "wheel": list(wheels), "panel.station": list(stations)}
    back = order_columns(permuted(given_, orders), paper())
    assert back.labels == given_.labels
    for name in given_.channels:
        np.testing.assert_array_equal(back[name], given_[name])


def test_what_is_in_order_is_given_back_as_it_is():
    assert order_columns(flown("exp2", 2.0), paper()) is flown("exp2", 2.0)


def test_columns_without_labels_are_in_the_models_order():
    given_ = flown("exp2", 2.0)
    bare = Recording.from_arrays(given_.time(), {"encoder.joint_position": given_["encoder.joint_position"]})
    assert order_columns(bare, paper()) is bare


@pytest.mark.parametrize(
    ("key", "labels", "unknown", "lacking"),
    [
        ("joint", ("joint1", "elbow", "joint3"), ("elbow",), ("joint2",)),
        ("wheel", ("wheel_x", "wheel_y", "rw4"), ("rw4",), ("wheel_z",)),
        ("panel.station", ("2 m", "5 m", "6 m"), ("5 m",), ("4 m",)),
    ],
)
def test_a_wrong_label_is_refused_by_name(key, labels, unknown, lacking):
    with pytest.raises(RecordingError) as caught:
        order_columns(relabelled(flown("exp2", 2.0), key, labels), paper())
    assert caught.value.evidence["unknown"] == unknown and caught.value.evidence["lacking"] == lacking
    assert unknown[0] in str(caught.value) and lacking[0] in str(caught.value)


@pytest.mark.parametrize("labels", [("6.0", "2.0", "4.0"), ("6 m", "2m", "4.00 m"), ("2", "0", "1")])
def test_stations_are_called_by_distance_or_by_index(labels):
    given_ = relabelled(flown("exp2", 2.0), "panel.station", labels)
    found = order_columns(given_, paper())["panel.acceleration"]
    np.testing.assert_array_equal(found, given_["panel.acceleration"][:, [1, 2, 0]])


def test_a_source_with_labels_of_its_own_is_ordered_by_them():
    given_ = flown("exp2", 2.0)
    channels = {n: (given_.time(n), given_[n]) for n in given_.channels}
    for name in ("encoder.joint_position", "encoder.joint_velocity"):
        channels[name] = (given_.time(name), given_[name][:, [1, 0, 2]])
    labels = {**given_.labels, "encoder.joint": ("joint2", "joint1", "joint3")}
    back = order_columns(Recording.from_arrays(given_.time(), channels, labels=labels), paper())
    np.testing.assert_array_equal(back["encoder.joint_position"], given_["encoder.joint_position"])
    np.testing.assert_array_equal(back["command.joint_torque"], given_["command.joint_torque"])


def test_the_names_of_mounted_arms_may_be_the_urdfs_where_they_are_unique():
    model = build_model(load_description(URDF / "two_arm_sms.toml"))
    names = model.arm_joints.names
    t, q = np.arange(3) / 10.0, np.arange(18.0).reshape(3, 6)
    turned = Recording.from_arrays(t, {"encoder.joint_position": q[:, ::-1]}, labels={"joint": names[::-1]})
    np.testing.assert_array_equal(order_columns(turned, model)["encoder.joint_position"], q)
    short = Recording.from_arrays(
        t,
        {"encoder.joint_position": q[:, :3]},
        labels={"joint": [n.rpartition("/")[2] for n in names[:3]]},
    )
    with pytest.raises(RecordingError, match="unknown 'joint1'"):  # both arms have a joint1
        order_columns(short, model)


def test_another_sources_joints_are_its_own():
    t, q = np.arange(3) / 10.0, np.zeros((3, 2))
    other = Recording.from_arrays(t, {"rover.joint_position": q}, labels={"joint": ["steer", "drive"]})
    assert order_columns(other, paper()) is other


@pytest.mark.parametrize(
    ("channel", "labels"),
    [
        ("panel.acceleration", {"panel.station": ("6 m", "2 m", "4 m")}),
        ("encoder.joint_position", {"joint": ("joint3", "joint1", "joint2"), "wheel": ("wheel_x",)}),
        ("imu.angular_rate", {"joint": ("joint3", "joint1", "joint2")}),
    ],
)
def test_one_reading_is_ordered_as_a_recording_is(channel, labels):
    given_ = flown("exp2", 2.0)
    own = {k: v for k, v in labels.items() if k != "wheel" and channel != "imu.angular_rate"}
    whole = Recording.from_arrays(given_.time(channel), {channel: given_[channel]}, labels=own)
    matrix, offset = column_map(labels, channel, given_[channel][0].size, paper())
    found = given_[channel].reshape(len(given_[channel]), -1) @ matrix.T + offset
    np.testing.assert_array_equal(found, order_columns(whole, paper())[channel].reshape(len(found), -1))


# Every consumer: the same numbers whatever the order.


def consumers():
    from smsid.estimation.measurements import measurements_of
    from smsid.identify.paper.motion import prepare
    from smsid.likelihood.nuisance_parameters import Nuisance
    from smsid.likelihood.recording_term import piece_of
    from smsid.report.stabilisation import diagrams
    from smsid.view._main import simulated_twin
    from smsid.view._recorded import recorded_motion

    def motion(r: Recording):
        m = prepare(paper(), r)
        return [m.angles, m.angle_rates, m.wheel_rates, m.panels["panel"]]

    def likelihood(r: Recording):
        piece, _ = piece_of(paper(), r, Nuisance())
        joints, wheels = piece.drive.joints, piece.drive.wheels
        assert joints is not None and wheels is not None
        return [joints.coefficients, wheels.coefficients, *(c.values for c in piece.channels)]

    def diagnosis(r: Recording):
        return [measurements_of(paper(), r, paper().description.effective_sensors()).values]

    def view(r: Recording):
        m = recorded_motion(paper(), r, 0.1, 1000)
        assert m.joint_torque is not None and m.wheel_torque is not None
        return [m.q, m.joint_torque, m.wheel_torque]

    def twin(r: Recording):
        states = simulated_twin(paper(), r.window(0.0, 1.0)).states(np.array([0.5, 1.0]))
        return [states.q, states.v]

    def figure(r: Recording):
        return [np.asarray([d.name for d in diagrams(paper(), r, {})])]

    return {
        "motion": motion,
        "likelihood": likelihood,
        "diagnosis": diagnosis,
        "view": view,
        "twin": twin,
        "figure": figure,
    }


@pytest.mark.parametrize("name", ["motion", "likelihood", "diagnosis", "view", "twin", "figure"])
def test_permuting_columns_with_their_labels_changes_no_result(name):
    own = consumers()[name]
    given_ = flown("exp2", 20.0)
    for a, b in zip(own(given_), own(permuted(given_, TURNED)), strict=True):
        if a.dtype.kind == "f":
            np.testing.assert_array_equal(a, b)
        else:
            assert a.tolist() == b.tolist()


def test_identification_takes_columns_by_their_labels():
    """Of maximum likelihood it is the terms, above, that are the same to the last bit."""
    from smsid.identify.paper.pipeline import identify

    given_, description = flown("exp2", 40.0), paper().description
    first = identify(description, [given_]).estimate
    second = identify(description, [permuted(given_, TURNED)]).estimate
    np.testing.assert_allclose(second.values, first.values, rtol=1e-12)
    other = identify(description, [relabelled(given_, "joint", ("joint2", "joint1", "joint3"))]).estimate
    known = [n for n in other.names if n in first and n.startswith("link3")]
    off = max(abs(other[n].value - first[n].value) / first[n].sigma for n in known)
    assert off > 10.0  # labels are heeded: of other joints the numbers are others


def test_every_entry_refuses_a_wrong_label_by_name():
    from smsid.diagnose.diagnose import diagnose
    from smsid.identify.paper.pipeline import identify
    from smsid.view._recorded import recorded_motion

    wrong = relabelled(flown("exp2", 20.0), "wheel", ("wheel_x", "wheel_y", "wheel_w"))
    description = paper().description
    with pytest.raises(RecordingError, match="'wheel_w'"):
        identify(description, [wrong])
    with pytest.raises(RecordingError, match="'wheel_w'"):
        recorded_motion(paper(), wrong, 0.1, 100)
    assert "'wheel_w'" in diagnose(description, [wrong]).diagnosis.sentence
