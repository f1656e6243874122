"""`smsid identify` on recordings as they should not be: inside its intervals, or it says why not."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from likelihood import twin
from likelihood.faulty import (
    SENSED,
    Change,
    changed,
    dead,
    late,
    missing,
    never_commanded,
    not_finite,
    of,
    outliers,
    saturated,
)

from smsid.cli import main
from smsid.errors import NotIdentifiableError
from smsid.identify import load_estimate
from smsid.identify.estimate import Estimate
from smsid.recording import Recording, save_recording

FAR = 4.0  # standard deviations
HOLE = (25.0, 27.0)  # [s]
REST = tuple(s for s in SENSED if s != "tachometer.")  # nothing else tells what the wheels do
OF_EXP1 = {"total.mass", "tank.mass", "tank.stiffness.x", "panel.linear_density", "panel.mode2.frequency"}
OF_EXP2 = {"bus.mx", "bus.Izz", "link2.mx", "link3.mx", "link3.Iyy"}
Discrimination = tuple[int, str, Estimate | None]


@pytest.fixture
def identify(tmp_path: Path, monkeypatch, capsys) -> Callable[..., Discrimination]:
    """Run the command on recordings, or files of them: exit code, all that it said, what it wrote."""

    def run(*recordings: Recording | Path, method: str = "ml", more: Sequence[str] = ()) -> Discrimination:
        out, words = tmp_path / "estimate.json", [str(twin.URDF / "paper_sms.toml")]
        for k, recording in enumerate(recordings):
            if isinstance(recording, Recording):
                recording = save_recording(recording, tmp_path / f"{k}.nc")
            words.append(str(recording))
        monkeypatch.setattr(
            sys, "argv", ["smsid", "identify", *words, "-o", str(out), "--method", method, "--all", *more]
        )
        code = 0
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        told = capsys.readouterr()
        assert out.exists() is (code == 0)  # all or nothing
        return code, " ".join(f"{told.out} {told.err}".split()), load_estimate(out) if code == 0 else None

    return run


def exp1(axes: tuple[int, int, int] = (1, 1, 1), duration: float = 60.0) -> Recording:
    return twin.noisy(twin.exp1(axes, duration), 0)


def exp2() -> Recording:
    return twin.noisy(twin.exp2(40.0), 0)


def inside(estimate: Estimate | None, least: set[str]) -> None:
    """Those are identifiable, and every identifiable one is within its interval: the description is true."""
    assert estimate is not None and estimate.method == "maximum_likelihood"
    good = [p for p in estimate.group("maximum_likelihood") if p.status == "identifiable"]
    assert least <= {p.name.split(" ")[0] for p in good}
    for p in good:
        assert p.nominal is not None
        assert abs(p.value - p.nominal) < FAR * p.sigma, f"{p.name}: {p.value} +- {p.sigma}"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (outliers, "imu.acceleration left out"),
        (of(REST, not_finite(*HOLE)), "of imu.acceleration bridged"),
        pytest.param(of(REST, missing(*HOLE)), "of imu.acceleration bridged", marks=pytest.mark.slow),
        pytest.param(
            late("panel"),
            "clocks that do not agree with the rest, estimated too: panel",
            marks=pytest.mark.slow,  # as `encoder`'s in Exp. 2, below
        ),
    ],
    ids=["outliers", "not finite", "missing", "clock"],
)
def test_exp1_is_inside_its_intervals(identify, change: Change, said: str):
    code, text, estimate = identify(changed(exp1(), change))
    assert code == 0, text
    assert said in text
    assert len(estimate.recordings) == 1 and estimate.recordings[0] not in "panel"
    inside(estimate, OF_EXP1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (outliers, "tachometer.wheel_rate bridged"),
        pytest.param(
            of(REST, not_finite(*HOLE)), "of encoder.joint_position bridged", marks=pytest.mark.slow
        ),
        (saturated("imu.angular_rate"), "imu.angular_rate left out"),
        (late("encoder"), "encoder.clock_offset is 0.03 +-"),
    ],
    ids=["outliers", "not finite", "saturated", "clock"],
)
def test_exp2_is_inside_its_intervals(identify, change: Change, said: str):
    code, text, estimate = identify(exp1(), changed(exp2(), change))
    assert code == 0, text
    assert said in text
    inside(estimate, OF_EXP1 | OF_EXP2)


def test_exp1_too_short(identify):
    code, text, estimate = identify(exp1().window(0.0, 2.0))
    assert code == 0, text
    inside(estimate, set())
    for name in ("tank.mass", "tank.stiffness.x", "tank.damping.x"):
        assert estimate[name].status == "not_identifiable"
        assert "the data do not see it" in estimate[name].note


@pytest.mark.parametrize("method", ["ml", "paper"])
def test_an_axis_without_thrust(identify, method: str):
    code, text, estimate = identify(exp1((1, 0, 0)), method=method)
    assert code == 0, text
    assert "no thrust along y, z" in text
    assert estimate["total.mass"].status == "identifiable"
    for name in ("stiffness.y", "damping.y", "stiffness.z", "damping.z"):
        p = estimate[f"tank.{name}"]
        assert p.status == "not_identifiable"
        assert ("the data do not see it" if method == "ml" else f"no thrust along {name[-1]}") in p.note
    if method == "ml":
        inside(estimate, {"total.mass", "tank.mass", "tank.stiffness.x"})


@pytest.mark.slow  # as `tests/identify/test_stationary_joints.py` has it without the command
def test_a_joint_that_stands_still(identify):
    locked = twin.noisy(twin.exp2(40.0, (("joint3", 1e12),)), 0, biased=False)
    code, text, estimate = identify(locked, method="paper")
    assert code == 0, text
    assert "joint3 stands still" in text
    own = [p for p in estimate.parameters if p.name.startswith("link3.")]
    assert len(own) == 7
    assert all(p.status == "not_identifiable" and "joint3 stands still" in p.note for p in own)


JOINTS = ("encoder.joint_position", "encoder.joint_velocity")
WHEELS = ("tachometer.wheel_rate",)


def turned(column: int) -> Change:
    """One column has the other sign."""

    def change(name: str, times: np.ndarray, values: np.ndarray):
        values[:, column] *= -1.0
        return times, values

    return change


def exchanged(*order: int) -> Change:
    """Columns stand in another order."""
    return lambda name, times, values: (times, values[:, list(order)])


def scaled(factor: float) -> Change:
    return lambda name, times, values: (times, factor * values)


def frozen(name: str, times: np.ndarray, values: np.ndarray):
    """The channel says one thing all the time, without noise."""
    return times, np.broadcast_to(values[0], values.shape)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("channels", "change", "said"),
    [
        (JOINTS, turned(1), "'joint2' seems to have the other sign"),
        (JOINTS, exchanged(0, 2, 1), "'joint2' and 'joint3' seem to be exchanged"),
    ],
    ids=["sign", "exchanged"],
)
def test_what_only_the_motion_contradicts_is_named(identify, channels, change: Change, said: str):
    """The search may come to rest, where nothing can be called identifiable, or not."""
    code, text, estimate = identify(changed(exp2(), of(channels, change)))
    assert said in text
    if code == 0:
        assert "The model does not explain the recordings" in text
        assert not [p for p in estimate.parameters if p.status == "identifiable"]


def test_a_search_without_rest_names_columns(identify, monkeypatch):
    def restless(*_):
        raise NotIdentifiableError("No rest.", advice="Give priors.")

    monkeypatch.setattr("smsid.estimation.identify._batch", restless)
    code, text, _ = identify(changed(exp2().window(0.0, 5.0), of(JOINTS, turned(1))))
    assert code == 1
    assert re.search(r"No rest\. in 'exp2' 'joint2' seems to have the other sign: .* Give priors\.", text)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["wheels", "force"])
def test_what_is_scaled_is_told_from_two_experiments(identify, which: str):
    """One alone cannot tell: the craft might be heavier."""
    first, second = exp1(), exp2()
    if which == "wheels":
        second = changed(second, of(WHEELS, scaled(1.1)))
    else:
        first = first.with_channels({"command.force": 1.1 * np.asarray(first["command.force"])})
    code, text, estimate = identify(first, second)
    assert code == 0, text
    assert re.search(r"One factor explains it, (1\.1|0\.9)\S* on all masses and springs", text)
    assert not [p for p in estimate.parameters if p.status == "identifiable"]


@pytest.mark.parametrize(
    "more",
    [(), pytest.param(("--modal", "printed"), marks=pytest.mark.slow)],
    ids=["smoother", "printed"],
)
@pytest.mark.parametrize("how", ["labelled rightly", "labelled wrongly"])
def test_joints_in_another_order_by_the_papers_method(identify, how: str, more: Sequence[str]):
    straight = exp2()
    labels = {**straight.labels, "joint": tuple(reversed(straight.labels["joint"]))}
    back = changed(straight, of(JOINTS, exchanged(2, 1, 0))) if how == "labelled rightly" else straight
    mixed = Recording.from_arrays(
        None, {c: (back.time(c), back[c]) for c in back.channels}, labels=labels, name="exp2"
    )
    code, text, estimate = identify(mixed, method="paper", more=more)
    assert code == 0, text
    good = [p for p in estimate.parameters if p.status == "identifiable" and p.nominal is not None]
    assert len(good) > 25 if how == "labelled rightly" else not good
    blamed = re.search(r"in 'exp2' 'joint1' and 'joint3' seem to be exchanged", " ".join(text.split()))
    assert (blamed is None) == (how == "labelled rightly"), text
    for p in good:
        assert abs(p.value - p.nominal) < FAR * p.sigma, f"{p.name}: {p.value} +- {p.sigma}"


def still_wheels(name: str, times: np.ndarray, values: np.ndarray):
    return times, 1e-4 * np.sin(values) if name == "tachometer.wheel_rate" else values


REFUSED = {
    "exp1: no thrust": (lambda: exp1((0, 0, 0), 5.0), "no thrust along x .* along y .* along z"),
    "exp1: command not finite": (lambda: never_commanded(exp1()), r"'command\.force' is not finite"),
    "exp1: saturated": (
        lambda: changed(exp1(), saturated("imu.acceleration")),
        r"'imu\.acceleration' x is stuck at .* for 33\.3 % of the samples",
    ),
    "exp1: dead": (lambda: changed(exp1(), dead("imu.angular_rate")), r"'imu\.angular_rate' \(33 %\)"),
    "exp1: much too short": (lambda: exp1().window(0.0, 0.05), r"few|short"),
    "exp2: too short": (lambda: exp2().window(0.0, 10.0), "lasts 10 s: too short"),
    "exp2: a gap of the tachometers": (
        lambda: changed(exp2(), of(("tachometer.",), missing(20.0, 22.0))),
        "wheels' rates are missing from",
    ),
    "exp1: frozen and without noise": (
        lambda: changed(exp1(), of(("imu.acceleration",), frozen)),
        r"'imu\.acceleration' x is stuck at .* while 'pose\.velocity' moves .* Leave the channel out",
    ),
    "exp2: frozen and without noise": (
        lambda: changed(exp2(), of(("imu.angular_rate",), frozen)),
        r"'imu\.angular_rate' x is stuck at .* while 'pose\.attitude' moves .* Leave the channel out",
    ),
    "exp2: axes exchanged": (
        lambda: changed(exp2(), of(("imu.angular_rate",), exchanged(1, 0, 2))),
        r"'imu\.angular_rate' x and y are swapped: .* Exchange the columns",
    ),
    "exp1: nothing moves": (
        lambda: exp1((0, 0, 0), 20.0),
        r"identifies nothing: no thrust along x .* Fly Exp\. 1 with thrust",
    ),
    "exp2: still wheels": (lambda: changed(exp2(), still_wheels), "No wheel turns"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused_with_the_reason(identify, case: str):
    make, match = REFUSED[case]
    code, text, _ = identify(make())
    assert code != 0
    assert re.search(match, text), text


@pytest.mark.parametrize("how", ["time goes back", "time not finite", "unit"])
def test_files_that_are_wrong_are_refused(identify, tmp_path: Path, how: str):
    file = save_recording(exp1(duration=60.0), tmp_path / "wrong.nc")
    with xr.open_dataset(file, engine="h5netcdf", decode_times=False, mask_and_scale=False) as opened:
        dataset = opened.load()
    clock = next(str(c) for c in dataset.coords if str(c).endswith("time"))
    times = np.array(dataset[clock].values)
    if how == "time goes back":
        times[3000:] -= 0.5
    elif how == "time not finite":
        times[3000] = np.nan
    else:
        dataset["imu.angular_rate"].attrs["unit"] = "deg/s"
    attributes = dataset[clock].attrs
    dataset = dataset.assign_coords({clock: (clock, times)})
    dataset[clock].attrs = attributes
    dataset.to_netcdf(file, engine="h5netcdf")
    code, text, _ = identify(file)
    assert code != 0
    assert {"time goes back": "time", "time not finite": "time", "unit": "imu.angular_rate"}[how] in text
