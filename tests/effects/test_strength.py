"""Every effect of the catalogue: nothing at zero strength, a slope there, and a TOML that keeps it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.description import Description, load_description, save_description
from smsid.effects import Effect, SloshNonlinearity, catalogue
from smsid.model import SpacecraftModel, build_model, rebuild
from smsid.recording.channels import QUANTITIES
from smsid.sensing import Sensor
from smsid.simulate import Fourier, Inputs
from smsid.simulate._dynamics import Dynamics
from tests.effects.test_catalogue import example

STRONG = sorted(kind for kind, cls in catalogue().items() if cls.strength)
NOT_SIMULATED = {"motor_coupling", "joint_offset"}  # of arms on the ground: see smsid.arm
RANDOM = {"quantisation": "rounding has no slope", "outliers": "drawn: its size has a slope, its share none"}
# the state has other dimensions: see test_oscillators, test_extra_mode, test_beam_mode and test_tank_fill
MORE_JOINTS = {"gear_compliance", "backlash", "extra_mode", "beam_mode", "tank_fill"}
PLACES = 5


@cache
def paper() -> tuple[Description, SpacecraftModel]:
    description = load_description(Path(__file__).resolve().parents[2] / "urdf" / "paper_sms.toml")
    return description, build_model(description)


def inputs(rng: np.random.Generator) -> Inputs:
    def series(size: int) -> Fourier:
        return Fourier(0.05, rng.normal(size=(size, 2)), rng.normal(size=(size, 2)), rng.normal(size=size))

    return Inputs(force=series(3), torque=series(3), wheel_torque=series(3), joint_torque=series(3))


def probe(description: Description, seed: int) -> np.ndarray:
    """Return accelerations at random states under random commands, and what sensors read but for noise.

    Joints that an effect has of its own come last: they are at rest, and their accelerations are left out.
    """
    rng = np.random.default_rng(seed)
    model = rebuild(paper()[1], description)
    dynamics = Dynamics(model, inputs(rng))
    parts, n = [], paper()[1].nv
    own = np.zeros(model.nv - n)
    for t in rng.uniform(15.0, 40.0, PLACES):
        q = pin.integrate(model.pin, model.home, np.append(rng.normal(size=n) * 0.3, own))
        parts.append(dynamics.acceleration(t, q, np.append(rng.normal(size=n) * 0.3, own))[:n])
    for sensor in description.effective_sensors():
        parts.append(np.asarray(sensor.position))
        parts += [readings(sensor, quantity, rng) for quantity in sensor.quantities]
    return np.concatenate([np.ravel(p) for p in parts])


def readings(sensor: Sensor, quantity: str, rng: np.random.Generator) -> np.ndarray:
    times = np.arange(200) * 0.2
    shape = (3, 3) if sensor.kind == "accelerometers" else (3,)
    signal = np.sin(np.multiply.outer(0.3 * times, rng.uniform(0.5, 1.0, shape)) + rng.uniform(0, 6, shape))
    if quantity == "attitude":
        signal = np.array([pin.Quaternion(pin.exp3(x)).coeffs() for x in signal])
    return sensor.measure(quantity, times, signal, None)


def without_strength(kind: str) -> Effect:
    """The example with its `strength` parameters at zero."""
    effect = example(kind)
    own = [p.name for p in effect.parameters()]
    zero = [n for n in own if n.removeprefix(f"{effect.name}.").partition(".")[0] in effect.strength]
    return effect.with_values(dict.fromkeys(zero, 0.0))


def simulated(kind: str) -> bool:
    return kind in STRONG and kind not in NOT_SIMULATED


@pytest.mark.parametrize("kind", [k for k in STRONG if simulated(k)])
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_an_effect_without_strength_changes_nothing_at_all(kind: str, seed: int) -> None:
    description, _ = paper()
    none = without_strength(kind)
    np.testing.assert_array_equal(probe(description.with_effects(none), seed), probe(description, seed))


@pytest.mark.parametrize("kind", [k for k in STRONG if simulated(k)])
def test_an_effect_with_strength_changes_something(kind: str) -> None:
    if kind in RANDOM or kind in MORE_JOINTS:
        pytest.skip(RANDOM.get(kind, "more joints"))
    description, _ = paper()
    assert np.abs(probe(description.with_effects(example(kind)), 1) - probe(description, 1)).max() > 1e-9


def _steps() -> list[tuple[str, str]]:
    found = []
    for kind in STRONG:
        if simulated(kind) and kind not in RANDOM and kind not in MORE_JOINTS:
            effect = example(kind)
            found += [
                (kind, p.name)
                for p in effect.parameters()
                if p.name.removeprefix(f"{effect.name}.").partition(".")[0] in effect.strength
            ]
    return found


@pytest.mark.parametrize(("kind", "name"), _steps())
def test_every_strength_has_a_slope_at_zero(kind: str, name: str) -> None:
    """The difference quotient settles as the step falls, and it is not zero."""
    description, _ = paper()
    none = without_strength(kind)
    rest = probe(description, 3)

    def quotient(step: float) -> np.ndarray:
        return (probe(description.with_effects(none.with_values({name: step})), 3) - rest) / step

    size = 1e-4 if kind != "gravity_gradient" else 1e-9  # the vertical turns at its root
    coarse, fine = quotient(size), quotient(size / 4)
    assert np.abs(fine).max() > 1e-9
    # what is left of the curvature; and rounding of the accelerations over the step
    assert np.abs(coarse - fine).max() < 2e-2 * np.abs(fine).max() + 1e-13 * np.abs(rest).max() / size


@pytest.mark.parametrize("kind", sorted(catalogue()))
def test_a_toml_keeps_it(kind: str, tmp_path: Path) -> None:
    description, _ = paper()
    effect = example(kind)
    save_description(description.with_effects(effect), tmp_path / "x.toml")
    assert load_description(tmp_path / "x.toml").get_effect(effect.name) == effect


@pytest.mark.parametrize("kind", sorted(catalogue()))
def test_families_and_aliases_are_of_the_catalogue(kind: str) -> None:
    cls = catalogue()[kind]
    families = {"friction", "drivetrain", "inertia", "slosh", "appendage", "actuator", "external", "sensor"}
    assert cls.family in families
    assert set(cls.aliases) <= set(catalogue()) - {kind}
    assert set(cls.strength) <= set(cls.model_fields)


def test_units_of_sensor_errors_are_those_of_their_channels() -> None:
    from smsid.effects.sensor import UNITS

    assert {q: QUANTITIES[q].unit for q in UNITS if q != "attitude"} | {"attitude": "rad"} == UNITS


def test_strong_springs_of_a_tank_are_begun_an_octave_apart():
    """Of a spring of 858 N/m^3, 300 and 3000 were less likely than none; 500 to 1000 were far likelier."""
    values = np.array(SloshNonlinearity.strong["cubic"])
    assert values[0] <= 30.0 and values[-1] >= 3e4
    assert (values[1:] / values[:-1] <= 2.0).all()
