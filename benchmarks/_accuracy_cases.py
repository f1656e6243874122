"""The cases of the accuracy benchmark: recordings of another engine, sensors, guesses; one run of one."""

from __future__ import annotations

import hashlib
import os
import xml.etree.ElementTree as ElementTree
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from _common import ROOT

from smsid.description.files import load_description
from smsid.description.schema import Description
from smsid.effects.appendage import BeamAppendage
from smsid.effects.slosh import Slosh
from smsid.errors import SmsidError
from smsid.identify.commanded import excited_axes
from smsid.identify.estimate import AS_PRINTED
from smsid.identify.paper._exp1_axis_data import axis_data
from smsid.identify.paper._translation import AxisEstimate, identify_axis
from smsid.identify.paper.combined import combine
from smsid.identify.paper.pipeline import Identification, identify
from smsid.model.build import build_model
from smsid.model.regressor import Regressor
from smsid.recording import Recording, import_recording
from smsid.sensing import Sensor, add_noise

OFF = 0.30  # relative error of the starting guesses
URDF = ROOT / "urdf" / "paper_sms.urdf"
TOML = ROOT / "urdf" / "paper_sms.toml"


@dataclass(frozen=True)
class Case:
    """One set of recordings; ``imu`` is the preset of the IMU, ``guess`` whether starting guesses are off.

    Exp. 2 alone takes the total mass, slosh and panel from the description, which has the true ones.
    """

    name: str
    recordings: tuple[str, ...]
    imu: str = "reference"
    guess: bool = False
    noise: bool = True


_FULL = ("exp1_xyz_modal3", "exp2_modal3")
_Z = ("exp1_z_modal3",)
IMUS = ("reference", "hg9900", "hg4930", "stim300")
CASES = (
    *(Case(f"{imu}", _FULL, imu) for imu in IMUS),
    *(Case(f"{imu}, z alone", _Z, imu) for imu in IMUS),
    *(Case(f"{imu}, Exp. 2 alone", ("exp2_modal3",), imu) for imu in IMUS),
    Case("guesses off by 30 %", _FULL, guess=True),
    Case("chain", ("exp1_xyz", "exp2")),
    Case("chain, z alone", ("exp1_z",)),
)
NOISE_FREE = (
    Case("noise-free", _FULL, noise=False),
    Case("noise-free, z alone", _Z, noise=False),
    Case("noise-free, guesses off by 30 %", _FULL, guess=True, noise=False),
    Case("noise-free, chain", ("exp1_xyz", "exp2"), noise=False),
    Case("noise-free, chain, z alone", ("exp1_z",), noise=False),
)


class Data:
    """The recordings, read once, and the description."""

    def __init__(self) -> None:
        folder = os.environ.get("SMSID_ORACLE", "")
        if not folder or not Path(folder).is_dir():
            raise SystemExit("Set SMSID_ORACLE to the folder of the reference recordings.")
        self.folder = Path(folder)
        self.description = load_description(TOML)
        self._read: dict[str, Recording] = {}

    def __getitem__(self, name: str) -> Recording:
        if name not in self._read:
            kind = "oracle_exp1" if name.startswith("exp1") else "oracle_exp2"
            self._read[name] = import_recording(self.folder / f"{name}.npz", kind)
        return self._read[name]

    def sums(self) -> dict[str, str]:
        """Return the SHA-256 of every input file."""
        names = sorted({r for case in CASES for r in case.recordings})
        files = [*(self.folder / f"{n}.npz" for n in names), TOML, URDF]
        return {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in files}

    def fingerprint(self) -> str:
        """Return a sum over inputs and the code that results depend on; other runs are not reused."""
        total = hashlib.sha256("".join(self.sums().values()).encode())
        parts = ("identify", "model", "effects", "sensing", "recording")
        files = [
            f for part in parts for f in (ROOT / "smsid" / part).rglob("*") if f.suffix in (".py", ".toml")
        ]
        for file in [Path(__file__), *sorted(files)]:
            total.update(file.read_bytes())
        return total.hexdigest()[:16]


def run(case: Case, seed: int, data: Data, folder: Path) -> tuple[dict[str, Any], Identification | None]:
    """Identify once: estimates by ``group|name`` as (value, sigma), timing, or why it failed."""
    sensors = [_with_imu(s, case.imu) for s in data.description.sensor]
    description = data.description.with_sensors(*sensors)
    recordings = [data[name] for name in case.recordings]
    if case.noise:
        recordings = [noisy(r, sensors, seed) for r in recordings]
    if case.guess:
        description = wrong_description(description, seed, folder)
    record: dict[str, Any] = {"case": case.name, "seed": seed}
    try:
        found = identify(description, recordings)
    except SmsidError as error:
        return {**record, "failed": f"{type(error).__name__}: {error}"}, None
    estimate = found.estimate
    values: dict[str, tuple[float, float]] = {}
    for p in estimate.parameters:
        values[f"{p.group}|{bare(p.name)}"] = (p.value, p.sigma)
    for axis in found.translation.axes if found.translation else ():
        for symbol in axis.names:
            values[f"axis {axis.axis}|{symbol}"] = axis[symbol]
    if found.translation:
        together = combine(_as_printed(description, recordings))
        values |= {f"printed|{symbol}": together[symbol] for symbol in together.names}
    if found.momentum:
        a = found.momentum.a_printed
        for k, axis in enumerate("xyz"):
            values[f"exp2.step_a_printed|system_cm.{axis}"] = (a.position[k], a.position_sigma[k])
        for name, value, sigma in zip(a.moments.base.names, a.moments.values, a.moments.sigma, strict=True):
            values[f"exp2.step_a_printed|{name}"] = (value, sigma)
    record["identifiable"] = [
        f"{p.group}|{bare(p.name)}" for p in estimate.parameters if p.status == "identifiable"
    ]
    record["values"] = {k: [_finite(x) for x in pair] for k, pair in values.items()}
    record["timing"] = dict(estimate.timing)
    record["notes"] = list(estimate.notes)
    return record, found


def _as_printed(description: Description, recordings: Iterable[Recording]) -> list[AxisEstimate]:
    """Return what the regression as printed says of every axis, where it says anything."""
    model, out = build_model(description), []
    for recording in recordings:
        for axis in excited_axes(recording):
            try:
                out.append(identify_axis(axis_data(model, recording, axis), len(model.slosh)))
            except SmsidError:
                continue
    return out


def bare(name: str) -> str:
    """Return a parameter's name without the step it comes from."""
    return name.removeprefix("step A: ").removeprefix(AS_PRINTED)


def noisy(recording: Recording, sensors: Iterable[Sensor], seed: int) -> Recording:
    """Return the recording as those sensors would make it whose channels it has."""
    present = [s for s in sensors if all(c in recording for c in s.channels)]
    rng = np.random.default_rng([seed, zlib.crc32(recording.name.encode())])
    return add_noise(recording, present, rng)


def _with_imu(sensor: Sensor, preset: str) -> Sensor:
    if sensor.kind != "imu":
        return sensor
    return Sensor(name=sensor.name, kind="imu", position=sensor.position, preset=preset)


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def wrong_description(description: Description, seed: int, folder: Path) -> Description:
    """Return it with every mass, inertia, slosh value and panel property 30 % too high or too low, at random.

    Untouched: geometry, wheel axes and inertia (the known momentum that everything is measured by), sensors.
    """
    rng = np.random.default_rng([seed, zlib.crc32(b"guess")])

    def off() -> float:
        return 1.0 + OFF * float(rng.choice([-1.0, 1.0]))

    tree = ElementTree.parse(URDF)
    for inertial in tree.getroot().iter("inertial"):
        factor = off()
        for node in (inertial.find("mass"), inertial.find("inertia")):
            assert node is not None
            for key, text in node.attrib.items():
                node.set(key, repr(float(float(text) * factor)))
    name = f"guess{seed}.urdf"
    tree.write(folder / name)
    effects = []
    for effect in description.effect:
        if isinstance(effect, Slosh):
            changed = {"mass": effect.mass * off()}
            for key in ("stiffness", "damping"):
                changed[key] = tuple(x * off() for x in getattr(effect, key))
            effects.append(effect.model_copy(update=changed))
        elif isinstance(effect, BeamAppendage):
            keys = ("density", "youngs_modulus", "damping")
            effects.append(effect.model_copy(update={k: getattr(effect, k) * off() for k in keys}))
    wrong = description.model_copy(update={"folder": folder, "urdf": name})
    return wrong.with_effects(*effects)


def truths(description: Description, found: Identification) -> dict[str, dict[str, Any]]:
    """Return, by ``group|name``: true value, reference and whether small, of a noise-free identification.

    Numbers of Exp. 1 are those of the paper as the reference recordings have them; inertial ones come from
    the description. ``small``: zero, or a column times value below 1 % of the measured momentum; such a
    parameter is compared to the largest of its kind on the same body (of the body's own ones if all
    combinations are zero).
    """
    plain = {
        "exp1|total.mass": 2256.8,
        "exp1|tank.mass": 49.6,
        "exp1|panel.linear_density": 16.2,
        "modes|panel.mode1.frequency": 0.045696,
        "modes|panel.mode2.frequency": 0.286370,
        "modes|panel.mode3.frequency": 0.801844,
        **{f"exp1|tank.stiffness.{axis}": 0.41 for axis in "xyz"},
        **{f"exp1|tank.damping.{axis}": 0.02 for axis in "xyz"},
        **{f"modes|panel.mode{k}.damping": 0.005 for k in (1, 2, 3)},
    }
    for axis in "xyz":
        for symbol, value in (("M", 2256.8), ("m_s", 49.6), ("k_s", 0.41), ("b_s", 0.02), ("rho", 1.0)):
            plain[f"axis {axis}|{symbol}"] = value
    for symbol, value in (("M", 2256.8), ("m_s", 49.6), ("rho", 1.0)):
        plain[f"printed|{symbol}"] = value
    for symbol, value in (("k_s", 0.41), ("b_s", 0.02)):
        plain |= {f"printed|{symbol}.{axis}": value for axis in "xyz"}
    out = {key: _truth(value, abs(value), False) for key, value in plain.items()}
    momentum = found.momentum
    assert momentum is not None
    model = build_model(description)
    regressor = Regressor(model)
    own = dict(zip(regressor.names, regressor.parameters, strict=True))
    centre = pin.centerOfMass(model.pin, model.pin.createData(), model.home)
    for step in ("exp2.step_a", "exp2.step_a_printed"):
        for k, axis in enumerate("xyz"):
            out[f"{step}|system_cm.{axis}"] = _truth(centre[k], float(np.linalg.norm(centre)), False)
        names = momentum.a.moments.base.names
        out |= _group(step, {name: _combination(name, own) for name in names}, own)
    shares = dict(zip(momentum.b.base.names, momentum.b.shares, strict=True))
    for step in ("exp2.step_b", "exp2.step_b_printed"):
        parameters = {bare(p.name): p for p in found.estimate.group(step)}
        values = {name: float(p.nominal) for name, p in parameters.items()}
        share = {}
        if step == "exp2.step_b":
            share = {n: shares[n] * abs(v / parameters[n].value) for n, v in values.items()}
        out |= _group(step, values, own, share)
    return out


def _group(
    step: str, values: dict[str, float], own: dict[str, float], share: dict[str, float] | None = None
) -> dict[str, dict[str, Any]]:
    """Truths of one step; ``share`` of the measured momentum where it is known."""
    zero = 1e-9 * max(abs(v) for v in values.values())
    out = {}
    for name, value in values.items():
        small = abs(value) < zero or (share or {}).get(name, 1.0) < 0.01
        peers = max(abs(v) for other, v in values.items() if _kind(other) == _kind(name))
        if peers < zero:
            peers = max((abs(v) for n, v in own.items() if _kind(n) == _kind(name)), default=0.0)
        if peers < zero:
            peers = max(abs(v) for v in values.values())  # products of zero moments
        out[f"{step}|{name}"] = _truth(value, peers if small else abs(value), small)
    return out


def _combination(name: str, own: dict[str, float]) -> float:
    """Value of a combination as it is written, ``link2.mx + 2 link3.m``."""
    total, sign, factor = 0.0, 1.0, 1.0
    for word in name.split():
        if word in "+-":
            sign = -1.0 if word == "-" else 1.0
        elif word in own:
            total += sign * factor * own[word]
            sign = factor = 1.0
        else:
            factor = float(word)
    return total


def _truth(value: float, reference: float, small: bool) -> dict[str, Any]:
    return {"value": float(value), "reference": float(reference), "small": bool(small)}


def _kind(name: str) -> tuple[str, str]:
    """Body and kind of a combination, from its leading term; products of first moments are one kind."""
    if name.startswith("("):
        return "", "product"
    body, symbol = name.split(" ", 1)[0].rsplit(".", 1)
    return body, {"m": "mass"}.get(symbol, "inertia" if symbol.startswith("I") else "moment")
