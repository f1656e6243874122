"""Exp. 1 from recordings to parameters, on Newton's equations solved exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from smsid.effects.slosh import Slosh
from smsid.errors import NotIdentifiableError
from smsid.identify.commanded import excited_axes
from smsid.identify.paper._exp1_result import assemble
from smsid.identify.paper.exp1 import averaged_at_steps, identify_translation
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import Sensor

from ..support import PARTICIPATION, TANK, TWO_TANKS, M, fly_exp1, noisy, paper

K = {"x": 0, "y": 1, "z": 2}


def recording(
    axes: str = "x", *, tanks=(TANK,), rate: float = 100.0, name: str = "exp1", **more
) -> Recording:
    """Thrust along ``axes``; along z the panel bends."""
    shapes = np.array([m.shape for m in paper().get_effect("panel").modal_data()])[:, :, 2]
    base = force = None
    for axis in axes:
        t, f, a = fly_exp1(tanks, panel=axis == "z", rate=rate)
        if base is None:
            base, force, panel = np.zeros((len(t), 3)), np.zeros((len(t), 3)), np.zeros((len(t), 3, 3))
        base[:, K[axis]], force[:, K[axis]] = a[:, 0], f
        panel[:, :, K[axis]] = a[:, :1]
        if axis == "z":
            panel[:, :, 2] += a[:, 1 + len(tanks) :] @ shapes
    velocity = cumulative_trapezoid(base, t, axis=0, initial=0.0)
    channels = {
        "imu.acceleration": base,
        "imu.angular_rate": np.zeros_like(base),
        "pose.velocity": velocity,
        "pose.position": cumulative_trapezoid(velocity, t, axis=0, initial=0.0),
        "pose.attitude": np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)),
        "panel.acceleration": panel,
        "command.force": force,
    }
    return Recording.from_arrays(t, {**channels, **more}, name=name)


def test_everything_along_three_axes(model):
    """Noise-free: M, tank and density; modes of the panel. What is left is the trapezoids' and the modes'."""
    found = identify_translation(model, [recording("xyz")])
    assert found.notes == ()
    values = {p.name: p.value for p in found.parameters}
    assert found.mass == values["total.mass"] == pytest.approx(M, rel=1e-8)
    assert values["tank.mass"] == pytest.approx(TANK[0], rel=1e-6)
    for axis in "xyz":
        assert values[f"tank.stiffness.{axis}"] == pytest.approx(TANK[1], rel=2e-6)
        assert values[f"tank.damping.{axis}"] == pytest.approx(TANK[2], rel=1e-4)
    assert values["panel.linear_density"] == pytest.approx(16.2, rel=1e-6)
    for k, frequency in enumerate((0.045696, 0.286373, 0.801848), start=1):
        assert values[f"panel.mode{k}.frequency"] == pytest.approx(frequency, rel=1e-4)
        assert values[f"panel.mode{k}.damping"] == pytest.approx(0.005, rel=0.02)
    assert PARTICIPATION[0] == pytest.approx(model.mode_scale[0], rel=1e-4)
    assert found.values()["tank.mass"] == values["tank.mass"]
    assert found.density_factor("panel") == pytest.approx(1.0, rel=1e-4)


def test_no_single_sample_decides(model):
    """A filter that extends the record about its first sample lets its error move rho forty times as far."""
    clean = recording("z")
    moved = clean["imu.acceleration"].copy()
    moved[0] += 1e-4
    one, other = (
        identify_translation(model, [r])
        for r in (clean, clean.with_channels({"imu.acceleration": (clean.time("imu.acceleration"), moved)}))
    )
    assert other.density_factor("panel") == pytest.approx(one.density_factor("panel"), rel=1e-4)


def test_intervals_cover_with_noise(model):
    """Reference noise: within four predicted sigmas, and those of k_s at the Cramer-Rao bound, 0.285 %."""
    found = identify_translation(model, [noisy(recording("xyz"), paper(), 5)])
    true = {"total.mass": M, "tank.mass": TANK[0], "panel.linear_density": 16.2}
    true |= {f"tank.stiffness.{a}": TANK[1] for a in "xyz"} | {f"tank.damping.{a}": TANK[2] for a in "xyz"}
    by_name = {p.name: p for p in found.parameters}
    for name, value in true.items():
        assert abs(by_name[name].value - value) < 4 * by_name[name].sigma, name
    assert by_name["tank.stiffness.x"].relative_sigma == pytest.approx(0.00285, rel=0.1)
    assert by_name["tank.mass"].status == "identifiable"
    assert by_name["tank.damping.x"].status == "not_identifiable"  # the paper's ">>"


def test_one_recording_per_axis(model):
    """The same as all at once; the names stay."""
    apart = identify_translation(model, [recording("x"), recording("y"), recording("z")])
    together = identify_translation(model, [recording("xyz")])
    assert [p.name for p in apart.parameters] == [p.name for p in together.parameters]
    mine, theirs = ([p.value for p in x.parameters if p.group == "exp1"] for x in (apart, together))
    np.testing.assert_allclose(mine, theirs, rtol=1e-9)


def test_an_axis_is_taken_from_the_first_recording_that_has_it(model):
    bad = recording("z", name="bare").without("panel.acceleration")
    found = identify_translation(model, [bad, recording("z")])
    assert found.mass == pytest.approx(M, rel=1e-4)
    assert any("axis z of 'bare': 'panel' bends along this axis" in n for n in found.notes)


def test_axes_without_thrust_are_noted(model):
    found = identify_translation(model, [recording("x")])
    assert "no thrust along y, z: stiffness and damping there stay as described" in found.notes
    assert set(found.values()) == {"tank.mass", "tank.stiffness.x", "tank.damping.x"}
    assert found.density_factor("panel") == 1.0


def test_changes_by_symbol_stay_physical(model):
    found = identify_translation(model, [recording("x")])
    assert found.values({"m_s": 1.0})["tank.mass"] == pytest.approx(TANK[0] + 1.0, rel=1e-3)
    assert found.values({"b_s.x": -1.0})["tank.damping.x"] == 0.0
    assert found.values({"m_s": -1e3})["tank.mass"] > 0.0


def test_thrust_held_on_a_slow_clock(model):
    """Commands every second, steps on the grid: held between samples, not interpolated."""
    exact = recording("x")
    t = exact.time()
    slow = np.where(t[::100] < 20, 40.0, np.where(t[::100] < 40, -40.0, 0.0))[:, None] * [1.0, 0.0, 0.0]
    own = exact.without("command.force").with_channels({"command.force": (t[::100], slow)})
    found = identify_translation(model, [own])
    # at the steps a sample is now the right limit, not the mean: half a sample late, of second order in M
    assert found.mass == pytest.approx(M, rel=1e-3)


def test_a_described_delay_of_the_imu_is_taken_out():
    """30 ms late: as without delay, and M is off by far more when the description does not know."""
    d = paper()
    sensor = Sensor(
        name="imu",
        kind="imu",
        rate=100.0,
        position=(0.5, 1.5, 0.6),
        errors={"acceleration": {"delay": 0.03}, "angular_rate": {"delay": 0.03}},
    )
    told = build_model(d.with_sensors(sensor, *(s for s in d.sensor if s.name != "imu")))
    exact = recording("x")
    late = np.concatenate([np.zeros((3, 3)), exact["imu.acceleration"][:-3]])
    own = exact.with_channels({"imu.acceleration": late})
    right, wrong = (identify_translation(m, [own]).combined for m in (told, build_model(d)))
    true = {"M": M, "m_s": TANK[0], "k_s.x": TANK[1]}
    for name, value in true.items():
        assert right[name][0] == pytest.approx(value, rel=2e-3)
    errors = [max(abs(r[n][0] / v - 1.0) for n, v in true.items()) for r in (right, wrong)]
    assert errors[1] > 5 * errors[0]


def test_what_nothing_can_have_is_not_identifiable(model):
    """A tank whose mass comes out negative, however small its sigma, is refused and stays as described."""
    exact = identify_translation(model, [recording("x")])
    axis = exact.axes[0]
    values = axis.values.copy()
    values[axis.names.index("m_s")] = -5.0
    values[axis.names.index("k_s")] = -0.1
    found = assemble(model, [replace(axis, values=values)], {}, [])
    by_name = {p.name: p for p in found.parameters}
    for name in ("tank.mass", "tank.stiffness.x"):
        assert by_name[name].status == "not_identifiable"
        assert "impossible" in by_name[name].note
    assert found.values() == {}
    assert any("tank.mass comes out as -5 kg" in n for n in found.notes)


def test_panel_on_another_clock(model):
    """Accelerometers at 50 Hz beside an IMU at 100 Hz."""
    exact = recording("z")
    t = exact.time()
    own = exact.without("panel.acceleration")
    own = own.with_channels({"panel.acceleration": (t[::2], exact["panel.acceleration"][::2])})
    found = identify_translation(model, [own])
    assert found.combined["rho"][0] == pytest.approx(1.0, rel=1e-3)
    assert found.mass == pytest.approx(M, rel=1e-4)


def test_described_frequencies_tell_tanks_apart():
    """Tanks named against the order of their frequencies keep their names."""
    described = paper().with_effects(
        Slosh(name="slow", position=(0, 0, 0), mass=60.0, stiffness=(0.4, 0.4, 0.4), damping=(0, 0, 0)),
        Slosh(name="tank", position=(0, 0, 0), mass=60.0, stiffness=(0.9, 0.9, 0.9), damping=(0, 0, 0)),
    )
    # the description lists the fast one, 'tank', first
    found = identify_translation(build_model(described), [recording("x", tanks=TWO_TANKS)])
    values = found.values()
    assert values["slow.mass"] == pytest.approx(49.6, rel=0.02)
    assert values["tank.mass"] == pytest.approx(70.0, rel=0.02)


def test_tanks_not_told_apart_stay_as_described():
    described = paper().with_effects(
        Slosh(name="other", position=(0, 0, 0), mass=40.0, stiffness=(0.4, 0.4, 0.4), damping=(0, 0, 0)),
    )
    same = recording("x", tanks=(TANK, TANK))
    found = identify_translation(build_model(described), [noisy(same, paper(), 0)])
    assert any("tanks cannot be told apart" in n for n in found.notes)
    assert found.values() == {}
    tanks = [p for p in found.parameters if p.name.startswith(("tank.", "other."))]
    assert tanks and all(p.status == "not_identifiable" for p in tanks)
    assert found.mass == pytest.approx(M, rel=2e-3)


def test_tanks_not_told_apart_need_a_period():
    """A third of a period of two tanks alike: as printed their total mass would be taken for known."""
    described = paper().with_effects(
        Slosh(name="other", position=(0, 0, 0), mass=40.0, stiffness=(0.4, 0.4, 0.4), damping=(0, 0, 0)),
    )
    same = noisy(recording("x", tanks=(TANK, TANK)), paper(), 0).window(0.0, 25.0)
    found = identify_translation(build_model(described), [same])
    assert not found.believed
    assert all(p.status != "identifiable" for p in found.parameters if p.group == "exp1")


def test_no_tank_at_all():
    d = paper()
    model = build_model(d.model_copy(update={"effect": tuple(e for e in d.effect if e.name != "tank")}))
    found = identify_translation(model, [noisy(recording("xyz", tanks=()), d, 0)])
    assert [p.name for p in found.parameters if p.group == "exp1"] == ["total.mass", "panel.linear_density"]
    assert abs(found.mass - M) < 4 * found.parameters[0].sigma < 2.0


def test_a_tactical_imu_cannot_see_the_slosh():
    """stim300: a turn-on bias of 0.75 mg is four tenths of what 40 N make; no tank is identifiable."""
    d = paper()
    imu = Sensor(name="imu", kind="imu", preset="stim300", position=(0.5, 1.5, 0.6))
    d = d.with_sensors(imu, *(s for s in d.sensor if s.name != "imu"))
    model, hidden = build_model(d), 0
    for seed in range(3):
        found = identify_translation(model, [noisy(recording("z"), d, seed)])
        own = {p.name: p for p in found.parameters if p.group == "exp1"}
        assert all(p.status == "not_identifiable" for n, p in own.items() if n.startswith("tank."))
        assert "total.mass" in own
        if not found.believed:  # nothing is told: all stays as described, with the reason
            hidden += 1
            assert all(p.value == p.nominal and "stays as described" in p.note for p in own.values())
        for p in own.values():
            if p.status == "identifiable":
                assert abs(p.value - p.nominal) < 4 * p.sigma
    assert hidden


def test_excited_axes():
    assert excited_axes(recording("xz")) == "xz"
    assert excited_axes(recording("x").without("command.force")) == ""


def test_rotation_is_refused(model):
    t = recording("x").time()
    turning = recording("x", **{"imu.angular_rate": 0.01 * np.sin(0.1 * t)[:, None] * [0.0, 0.0, 1.0]})
    with pytest.raises(
        NotIdentifiableError, match=r"'exp1' rotates at up to 0.0107 rad/s, so it is no Exp. 1"
    ):
        identify_translation(model, [turning])


def test_an_arm_that_moves_meanwhile_is_refused_and_one_that_trembles_is_not(model):
    t = recording("x").time()
    moving, trembling = (size * np.sin(0.1 * t)[:, None] * [0.0, 1.0, 0.0] for size in (0.3, 1e-3))
    with pytest.raises(NotIdentifiableError, match=r"The arm moves by 0.6 .*'exp1'") as caught:
        identify_translation(model, [recording("x", **{"encoder.joint_position": moving})])
    assert caught.value.evidence["other_flight"]
    held = recording("x", **{"encoder.joint_position": trembling})
    assert identify_translation(model, [held]).mass == pytest.approx(M, rel=1e-4)


def test_the_noise_of_a_cheap_gyro_is_no_rotation():
    noise = np.random.default_rng(8).normal(scale=2e-3, size=(12001, 3))
    noisy_gyro = recording("x", **{"imu.angular_rate": noise})
    described = paper()
    sensors = [s.model_dump(exclude_unset=True) for s in described.sensor]
    next(s for s in sensors if s["name"] == "imu")["errors"]["angular_rate"] = {"noise_sigma": 2e-3}
    cheap = described.model_copy(update={"sensor": tuple(Sensor(**s) for s in sensors)})
    assert identify_translation(build_model(cheap), [noisy_gyro]).mass == pytest.approx(M, rel=1e-4)
    with pytest.raises(NotIdentifiableError, match=r"rotates at up to .*state noise_sigma of 'imu'"):
        identify_translation(build_model(described), [noisy_gyro])


def test_a_constant_gyro_bias_is_no_rotation(model):
    biased = recording("x", **{"imu.angular_rate": np.full((12001, 3), 0.01)})
    assert identify_translation(model, [biased]).mass == pytest.approx(M, rel=1e-4)


def test_a_record_cut_out_of_a_longer_one_is_refused(model):
    """From 10 s on the spacecraft moves and the slosh swings already."""
    with pytest.raises(NotIdentifiableError, match="not start at rest: the velocity of the tracked point"):
        identify_translation(model, [noisy(recording("x"), paper(), 0).window(10.0, 120.0)])


def test_without_velocity_the_start_is_taken_on_trust(model):
    found = identify_translation(model, [recording("x").without("pose.velocity")])
    assert any("taken on trust" in n for n in found.notes)
    assert found.mass == pytest.approx(M, rel=1e-4)


def test_missing_panel_accelerometers_are_refused(model):
    with pytest.raises(NotIdentifiableError, match=r"'panel' bends along this axis but .* no accelerometers"):
        identify_translation(model, [recording("z").without("panel.acceleration")])


def test_too_few_stations_are_refused():
    d = paper()
    two = next(s for s in d.sensor if s.name == "panel").model_copy(update={"stations": (0, 1)})
    model = build_model(d.with_sensors(*(s for s in d.sensor if s.name != "panel"), two))
    exact = recording("z")
    short = exact.with_channels({"panel.acceleration": exact["panel.acceleration"][:, :2]}, labels={})
    with pytest.raises(
        NotIdentifiableError, match=r"2 accelerometers cannot tell the 3 modes of 'panel' apart"
    ):
        identify_translation(model, [short])


def test_no_recording_is_refused(model):
    with pytest.raises(NotIdentifiableError, match=r"Exp\. 1 identifies nothing"):
        identify_translation(model, [])


def test_a_sample_at_a_step_is_what_an_anti_aliased_sensor_reads():
    """A sample that has the whole step is half a sample early; thrust that never rests has no steps."""
    time = np.arange(100) / 10.0
    step = np.where(time >= 4.0, 2.0, 0.0)
    found = averaged_at_steps(time, np.column_stack([step, -step]), np.array([4.0]))
    np.testing.assert_allclose(found[[39, 40, 41]], [[0.0, 0.0], [1.0, -1.0], [2.0, -2.0]])
    between = averaged_at_steps(time, step, np.array([4.03, 0.0, 99.0]))
    np.testing.assert_array_equal(between, step)
    np.testing.assert_array_equal(averaged_at_steps(time, step, time), step)
