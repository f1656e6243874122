"""From description and recordings to an estimate, on MuJoCo recordings with the reference noise."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import smsid.identify
from smsid.description import Description, load_description
from smsid.effects.appendage import BeamAppendage
from smsid.effects.slosh import Slosh
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.experiments import fly, fourier_experiment, thrust_experiment
from smsid.identify import Identification, identify, load_estimate, save_estimate
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import Sensor

from ..support import URDF, noisy, oracle, paper, reference


def pair(seed: int) -> list[Recording]:
    """Exp. 1 and 2 of MuJoCo, as the reference sensors would have recorded them."""
    d = paper()
    return [
        noisy(reference("exp1_xyz_modal3"), d, seed),
        noisy(reference("exp2_modal3"), d, 1000 + seed),
    ]


def truth(name: str, nominal: float) -> float:
    return nominal if name.split(".")[0] != "total" else 2256.8


def off_by_30_percent(folder: Path) -> Description:
    """Masses, inertias, slosh, panel's density and stiffness; geometry, c_s and wheels kept."""
    text = (URDF / "paper_sms.urdf").read_text()

    def up(match: re.Match[str]) -> str:
        return f'{match[1]}"{1.3 * float(match[2])!r}"'

    text = re.sub(r'(mass value=)"([^"]+)"', up, text)
    (folder / "heavy.urdf").write_text(re.sub(r'(i(?:xx|yy|zz)=)"([^"]+)"', up, text))
    d = paper().model_copy(update={"urdf": "heavy.urdf", "folder": folder, "meshes": "ignored"})
    tank, panel = d.get_effect("tank"), d.get_effect("panel")
    assert isinstance(tank, Slosh) and isinstance(panel, BeamAppendage)
    slosh = {
        "mass": 0.7 * tank.mass,
        "stiffness": tuple(1.3 * x for x in tank.stiffness),
        "damping": tuple(1.3 * x for x in tank.damping),
    }
    stiffer = {"density": 1.3 * panel.density, "youngs_modulus": 0.7 * panel.youngs_modulus}
    return d.with_effects(tank.model_copy(update=slosh), panel.model_copy(update=stiffer))


@pytest.fixture(scope="module")
def first() -> Identification:
    return identify(paper(), pair(0))


@oracle
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_errors_within_four_sigmas(first, seed: int):
    """Every identifiable parameter of Exp. 1 and of Step B."""
    found = (first if seed == 0 else identify(paper(), pair(seed))).estimate
    own = [p for p in found.parameters if p.status == "identifiable" and p.group != "exp2.step_b_printed"]
    judged = [p for p in own if p.nominal is not None]
    assert len(judged) > 35
    off = {p.name: (p.value - truth(p.name, p.nominal)) / p.sigma for p in judged}
    assert max(map(abs, off.values())) < 4.0, off


@oracle
def test_errors_are_the_papers(first):
    """Table 2: M 0.04 %, m_s 0.6 %, k_s 0.78 %, rho 2.3 %, frequencies 0.11 to 0.35 %; a sigma more here."""
    e = first.estimate
    assert e["total.mass"].relative_error(2256.8) < 1e-3
    assert e["tank.mass"].relative_error(49.6) < 0.012
    for axis in "xyz":
        assert e[f"tank.stiffness.{axis}"].relative_error(0.41) < 0.02
        assert e[f"tank.damping.{axis}"].status == "not_identifiable"
    assert e["panel.linear_density"].relative_error(16.2) < 0.0227
    for k, (frequency, error) in enumerate(((0.0457, 1e-3), (0.28637, 3.5e-3), (0.80185, 2.5e-3)), start=1):
        assert e[f"panel.mode{k}.frequency"].relative_error(frequency) < error


@oracle
def test_step_b_within_a_per_cent(first):
    """Inertias and first moments that matter to the momentum: 1.5 %; Table 3 has 0.01 to 4.8 %."""
    large = [p for p in first.estimate.group("exp2.step_b") if not p.small]
    assert len(large) > 12
    assert max(p.relative_error(p.nominal) for p in large) < 0.015


@oracle
def test_the_description_is_only_a_guess(first, tmp_path):
    """Everything off by 30 %: the same result to a fraction of a sigma."""
    d = off_by_30_percent(tmp_path)
    assert build_model(d).mass > 2800.0
    found = identify(d, pair(0)).estimate
    for group in ("exp1", "modes", "exp2.step_a", "exp2.step_b"):
        assert len(found.group(group)) == len(first.estimate.group(group)) > 0
        for p, q in zip(found.group(group), first.estimate.group(group), strict=True):
            assert (p.name, p.status) == (q.name, q.status)
            assert abs(p.value - q.value) < 0.2 * q.sigma, p.name
            assert p.sigma == pytest.approx(q.sigma, rel=0.1), p.name


@oracle
def test_the_identified_description_is_the_models(first):
    """What comes back as a description can be built, and carries Exp. 1's tank and panel."""
    model = build_model(first.description)
    e = first.estimate
    tank = first.description.get_effect("tank")
    assert isinstance(tank, Slosh)
    assert tank.mass == e["tank.mass"].value
    assert tank.stiffness == tuple(e[f"tank.stiffness.{a}"].value for a in "xyz")
    panel = first.description.get_effect("panel")
    assert panel.rigid_inertia().mass == pytest.approx(6.0 * e["panel.linear_density"].value)
    assert panel.modal_data()[0].frequency == e["panel.mode1.frequency"].value
    assert len(model.modes) == 3


@oracle
def test_estimate_survives_its_file(first, tmp_path):
    save_estimate(first.estimate, tmp_path / "e.json")
    assert load_estimate(tmp_path / "e.json").to_json() == first.estimate.to_json()
    json.loads((tmp_path / "e.json").read_text(), parse_constant=lambda x: pytest.fail(x))


@oracle
def test_what_the_estimate_says_of_itself(first):
    e = first.estimate
    assert e.description == "paper_sms" and e.method == "paper"
    assert e.recordings == ("exp1", "exp2") and e.notes == ()
    assert e.timing["total"] >= sum(v for k, v in e.timing.items() if k != "total") - 1e-6
    assert all(p.unit and p.group for p in e.parameters)


@pytest.fixture(scope="module")
def spread() -> dict[str, dict[str, float]]:
    """Spread over predicted sigma by group and parameter: 40 seeds, 2 to 4 s each."""
    values: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for seed in range(40):
        for p in identify(paper(), pair(seed)).estimate.parameters:
            values.setdefault((p.group, p.name), []).append((p.value, p.sigma))
    ratio: dict[str, dict[str, float]] = {"exp1": {}, "exp2.step_a": {}, "exp2.step_b": {}}
    for (group, name), found in values.items():
        if group in ratio:
            value, sigma = np.array(found).T
            ratio[group][name] = float(np.std(value, ddof=1) / np.sqrt(np.mean(sigma**2)))
    return ratio


@oracle
@pytest.mark.slow
def test_predicted_sigmas_are_no_less_than_the_spread(spread):
    """A spread is known to 11 % from 40 seeds, three of those are allowed; Exp. 1, Steps A and B.

    Sigmas of Exp. 1, which need no replicates, are the spread: 0.96 of the 40 here, known to 5 %.
    """
    ratio = [r for own in spread.values() for r in own.values()]
    assert len(ratio) > 45
    assert max(ratio) < 1.34, spread
    assert min(spread["exp1"].values()) > 0.66, spread
    assert np.mean(list(spread["exp1"].values())) == pytest.approx(1.0, abs=0.15)


@oracle
@pytest.mark.slow
@pytest.mark.parametrize("group", ["exp2.step_a", "exp2.step_b"])
@pytest.mark.xfail(strict=True, reason="sigmas of Steps A and B are a quarter too large: 0.79 and 0.75")
def test_predicted_sigmas_of_few_replicates_are_the_spread(spread, group):
    """Not reached, on the safe side. Of Step B with Exp. 1 known exactly it is 0.81 (40 seeds).

    Their covariances take a factor, a floor and a squared bias from four replicates on every fourth sample,
    the same draws for all seeds, and Student's t asks for 1.6 times what four show, for intervals to hold.
    Before they had to for poor flights (one factor for all parameters), Step A's were the spread.
    """
    ratio = list(spread[group].values())
    assert min(ratio) > 0.66 and np.mean(ratio) == pytest.approx(1.0, abs=0.1), spread[group]


@oracle
def test_exp2_alone_takes_the_rest_from_the_description():
    found = identify(paper(), pair(0)[1:])
    assert found.translation is None
    assert any("no Exp. 1 was given" in n for n in found.estimate.notes)
    for p in found.estimate.group("exp2.step_b"):
        if p.status == "identifiable":
            assert abs(p.value - p.nominal) < 4 * p.sigma, p.name


@oracle
@pytest.mark.slow
def test_refined_tracked_point():
    """Described 4 cm off, by name in the estimate with its interval, and Step A mended."""
    d = paper()
    moved = [
        s.model_copy(update={"position": (0.5, 1.54, 0.6)}) if s.name in ("pose", "imu") else s
        for s in d.sensor
    ]
    found = identify(d.with_sensors(*moved), pair(0), refine_pose_point=True).estimate
    for axis, true in zip("xyz", (0.5, 1.5, 0.6), strict=True):
        p = found[f"pose_point.{axis}"]
        assert p.unit == "m" and abs(p.value - true) < 4 * p.sigma < 0.05
    assert found["pose_point.y"].nominal == 1.54


# --- other spacecraft, flown by smsid itself ----------------------------------------------------------------


def flown(d: Description, *, exp1: str = "", exp2: bool = True) -> list[Recording]:
    model = build_model(d)
    rng = np.random.default_rng(7)
    experiments = [thrust_experiment(exp1)] if exp1 else []
    if exp2:
        experiments.append(fourier_experiment(model, rng, candidates=1).experiment)
    return [fly(model, e, rng).recording for e in experiments]


def without(d: Description, *effects: str, sensors: tuple[str, ...] = ()) -> Description:
    return d.model_copy(
        update={
            "effect": tuple(e for e in d.effect if e.name not in effects),
            "sensor": tuple(s for s in d.sensor if s.name not in sensors),
        }
    )


def assert_covered(found: Identification, groups: tuple[str, ...], least: int) -> None:
    own = [p for p in found.estimate.parameters if p.status == "identifiable" and p.group in groups]
    assert len([p for p in own if p.nominal is not None]) >= least
    for p in own:
        if p.nominal is not None:
            assert abs(p.value - p.nominal) < 4 * p.sigma, p


@pytest.mark.slow  # `test_exp1.py` flies without a tank, too
def test_without_slosh():
    d = without(paper(), "tank")
    found = identify(d, flown(d, exp1="z"))
    assert_covered(found, ("exp1", "modes", "exp2.step_b"), 25)
    assert found.estimate["total.mass"].sigma < 0.3  # no slosh to hide the mass
    assert any("needs one slosh mass, 'paper_sms' has 0" in n for n in found.estimate.notes)


@pytest.mark.slow
def test_without_panel():
    d = without(paper(), "panel", sensors=("panel",))
    found = identify(d, flown(d, exp1="x"))
    assert_covered(found, ("exp1", "exp2.step_b"), 25)
    assert not found.estimate.group("modes")


def test_without_arm():
    """A bus with wheels, tank and panel: Step A has no links, Step B the bus alone."""
    d = load_description(URDF / "two_arm_sms.toml")
    d = without(d, "oxidiser", "panel_b", sensors=("encoder", "panel_b")).model_copy(update={"arm": ()})
    found = identify(d, flown(d, exp1="z"))
    assert found.momentum is not None
    assert len(found.momentum.a.moments.base) == 0
    assert {n.split(".")[0] for n in found.momentum.b.base.names} == {"bus"}
    assert_covered(found, ("exp1", "exp2.step_b"), 8)


def test_two_arms():
    """Exp. 2 of two arms, two tanks, two panels, four wheels, Exp. 1's part known: both arms' parameters."""
    d = load_description(URDF / "two_arm_sms.toml")
    found = identify(d, flown(d))
    assert_covered(found, ("exp2.step_b",), 40)
    for arm in ("left", "right"):
        p = found.estimate[f"{arm}/link2.mx + 2 {arm}/link3.m"]
        assert p.status == "identifiable" and p.relative_error(150.0) < 0.02
        assert found.estimate[f"{arm}/link3.mx"].relative_error(50.0) < 0.02


@pytest.mark.parametrize("axes", [pytest.param("x", marks=pytest.mark.slow), "z"])
def test_two_tanks_and_two_panels_in_exp1(axes: str):
    """Two tanks of nearly one frequency (ill-conditioned, 3e5): M and density are identified, tanks hardly.

    What cannot be told says so, and nothing identifiable is off by four sigmas.
    """
    d = load_description(URDF / "two_arm_sms.toml")
    found = identify(d, flown(d, exp1=axes, exp2=False))
    assert_covered(found, ("exp1", "modes"), 1 if axes == "x" else 10)
    assert found.estimate["total.mass"].relative_error(2534.0) < 5e-3
    other = "yz" if axes == "x" else "xy"
    assert any(f"no thrust along {other[0]}, {other[1]}" in n for n in found.estimate.notes)
    doubtful = [p for p in found.estimate.parameters if p.status == "not_identifiable"]
    # panels bend along z, and being alike they do so alike
    assert {p.name.split(".")[0] for p in doubtful} == {"fuel", "oxidiser", "panel_a", "panel_b"}
    assert all(p.note for p in doubtful)
    if axes == "z":
        densities = [found.estimate[f"panel_{k}.linear_density"] for k in "ab"]
        assert all("told only together" in p.note for p in densities)
        (together,) = [p for p in found.estimate.group("exp1") if "panel_a" in p.name and " + " in p.name]
        assert together.status == "identifiable"
        assert abs(together.value - 32.4) < 3.0 * together.sigma


def test_sensors_of_different_rates():
    """IMU stim300 at 250 Hz, star tracker at 10 Hz and 50 ms late, position and velocity at 100 Hz."""
    d = paper()
    point = next(s for s in d.sensor if s.name == "pose").position
    gps = Sensor(
        name="gps",
        kind="pose",
        rate=100.0,
        position=point,
        quantities=("position", "velocity"),
        errors={q: {"noise_sigma": 1e-3} for q in ("position", "velocity")},
    )
    tracker = Sensor(name="tracker", kind="pose", preset="astro-aps")
    imu = Sensor(name="imu", kind="imu", preset="stim300", position=point)
    d = d.with_sensors(gps, tracker, imu, *(s for s in d.sensor if s.name not in ("pose", "imu")))
    (recording,) = flown(d)
    rates = {c.split(".")[0]: 1 / float(np.diff(recording.time(c)).mean()) for c in recording.channels}
    assert (round(rates["imu"]), round(rates["tracker"]), round(rates["gps"])) == (250, 10, 100)
    found = identify(d, [recording])
    assert found.momentum is not None
    assert found.momentum.motion.step == pytest.approx(0.048)
    large = [p for p in found.estimate.group("exp2.step_b") if not p.small]
    # a turn-on bias of 0.75 mg bends the estimated panel: a known weakness that is not in the interval
    assert max(p.relative_error(p.nominal) for p in large) < 0.2


# --- refusals ----------------------------------------------------------------------------------------------


def minimal(name: str = "exp2", **channels) -> Recording:
    t = np.arange(3000) / 100.0
    rate = np.sin(t)[:, None] * np.ones(3)
    return Recording.from_arrays(t, {"imu.angular_rate": rate, **channels}, name=name)


def test_no_recording_is_refused():
    with pytest.raises(RecordingError, match="No recording was given"):
        identify(paper(), [])


def test_validation_data_are_refused():
    with pytest.raises(RecordingError, match="'exp2' is for validation"):
        identify(paper(), [minimal().with_role("validation")])


def test_two_of_exp2_are_refused():
    with pytest.raises(NotIdentifiableError, match=r"2 recordings of Exp. 2 were given \(a, b\)"):
        identify(paper(), [minimal("a"), minimal("b")])


def test_nan_is_refused():
    bad = np.sin(np.arange(3000) / 100.0)[:, None] * np.ones(3)
    bad[1234, 1] = np.nan
    with pytest.raises(RecordingError, match=r"imu.angular_rate"):
        identify(paper(), [minimal(**{"imu.angular_rate": bad})])


def test_missing_channels_are_refused():
    with pytest.raises(RecordingError, match=r"has no imu with acceleration, angular_rate"):
        identify(paper(), [minimal()])


def test_a_welded_spacecraft_is_refused():
    with pytest.raises(NotIdentifiableError, match="'paper_sms' is welded to the ground"):
        identify(paper().model_copy(update={"root": "fixed"}), [minimal()])


def test_public_names_are_there_and_light():
    """Everything in __all__, and no plotting, server or other engine comes along."""
    assert all(hasattr(smsid.identify, n) for n in smsid.identify.__all__)
    assert callable(smsid.identify.panel_modes) and callable(smsid.identify.identify)
    code = (
        "import sys, smsid.identify\n"
        "heavy = {'matplotlib', 'meshcat', 'mujoco', 'sympy', 'control'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
