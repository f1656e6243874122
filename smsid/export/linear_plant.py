"""The linear plant of a spacecraft or arm at home, with named states, inputs and outputs."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from smsid._files import atomic_path, atomic_write
from smsid._short_repr import short_repr
from smsid.control.identified_model import identified_model
from smsid.description import Description
from smsid.errors import ControlError, OutputError, SmsidError, require
from smsid.identify.estimate import Estimate
from smsid.model import SpacecraftModel, build_model

logger = logging.getLogger(__name__)

AXES = "xyz"
STEP = 1e-4
"""Of central differences of fourth order [rad | m], [rad/s | m/s]."""

FORMATS = (".json", ".mat")


@short_repr
@dataclass(frozen=True, eq=False)
class LinearPlant:
    """x' = a x + b u, y = x about rest at home: ``a`` (n, n), ``b`` (n, m), names of states and inputs.

    States are the coordinates (bus: position in inertial and rotation vector in bus axes, as small motions),
    then their rates. ``units`` go with the states, ``input_units`` with the inputs. ``a_sigma`` and
    ``b_sigma`` are standard deviations by ``draws`` of the estimate, None without one. ``notes`` say what was
    left out.
    """

    name: str
    a: np.ndarray
    b: np.ndarray
    states: tuple[str, ...]
    units: tuple[str, ...]
    inputs: tuple[str, ...]
    input_units: tuple[str, ...]
    a_sigma: np.ndarray | None = None
    b_sigma: np.ndarray | None = None
    draws: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    notes: tuple[str, ...] = ()

    def state_space(self) -> Any:
        """Return it as ``control.StateSpace``, all states as outputs.

        Raises `MissingDependencyError` without python-control (extra ``control``).
        """
        control = require("control", "control")
        n, m = self.b.shape
        # python-control takes no dots in names
        inputs, states = ([x.replace(".", "_") for x in names] for names in (self.inputs, self.states))
        return control.ss(
            self.a, self.b, np.eye(n), np.zeros((n, m)), inputs=inputs, outputs=states,
            states=[f"{x} state" for x in states], name=self.name.replace(".", "_"),
        )  # fmt: skip

    def document(self) -> dict[str, Any]:
        """Return it as a dictionary of arrays and names, as the files hold it."""
        n, m = self.b.shape
        found: dict[str, Any] = {"name": self.name, "A": self.a, "B": self.b}
        found |= {"C": np.eye(n), "D": np.zeros((n, m))}
        found |= {"states": self.states, "outputs": self.states, "units": self.units}
        found |= {"inputs": self.inputs, "input_units": self.input_units, "notes": self.notes}
        if self.a_sigma is not None and self.b_sigma is not None:
            found |= {"A_sigma": self.a_sigma, "B_sigma": self.b_sigma}
            found |= {f"{name}_draws": np.array([x[k] for x in self.draws]) for k, name in enumerate("AB")}
        return found


def linear_plant(
    description: Description,
    estimate: Estimate | None = None,
    *,
    draws: int = 20,
    rng: np.random.Generator | None = None,
) -> LinearPlant:
    """Linearise a spacecraft about rest at home, as identified or as described.

    Args:
        description: of the spacecraft or arm.
        estimate: of it; its values are used, and its covariance (or intervals) for the plant's uncertainty.
        draws: of the estimate, for the uncertainty.
        rng: for them; default a generator of fixed seed.

    Raises:
        ControlError: it cannot rest at home, or as `identified_model`.
        DescriptionError: as `build_model`.
    """
    smooth, notes = _smooth(build_model(description).description)  # with the friction of its URDFs
    if estimate is None:
        return _linearise(build_model(smooth), description.name, notes)
    plant = _linearise(identified_model(smooth, estimate).model, description.name, notes)
    found = []
    for values in _draw_parameters(estimate, draws, rng or np.random.default_rng(0)):
        pairs = zip(estimate.parameters, values, strict=True)
        drawn = replace(estimate, parameters=tuple(replace(p, value=float(x)) for p, x in pairs))
        try:
            one = _linearise(identified_model(smooth, drawn).model, "", [])
        except SmsidError as error:  # a draw that no rigid body can have
            logger.info("a draw of the estimate is left out: %s", error)
            continue
        found.append((one.a, one.b))
    if len(found) < 2:
        note = "no uncertainty: the estimate's draws are no spacecraft, or it has no intervals"
        return replace(plant, notes=(*plant.notes, note))
    a, b = (np.std([pair[k] for pair in found], axis=0, ddof=1) for k in (0, 1))
    return replace(plant, a_sigma=a, b_sigma=b, draws=tuple(found))


def save_linear_plant(plant: LinearPlant, path: str | os.PathLike[str]) -> Path:
    """Write a plant as JSON or MATLAB file, by the suffix; it appears whole or not at all.

    In MATLAB: ``p = load('plant.mat'); sys = ss(p.A, p.B, p.C, p.D, 'InputName', p.inputs)``.

    Raises:
        OutputError: another suffix.
    """
    file, document = Path(path), plant.document()
    if file.suffix.lower() == ".json":
        ready = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in document.items()}
        atomic_write(file, json.dumps({"kind": "linear_plant", **ready}, indent=1) + "\n")
    elif file.suffix.lower() == ".mat":
        from scipy.io import savemat

        cells = {
            k: np.array(v, dtype=object)[:, None] if isinstance(v, tuple) else v for k, v in document.items()
        }
        stream = BytesIO()
        savemat(stream, {k: v for k, v in cells.items() if np.size(v)})
        with atomic_path(file) as temporary:
            Path(temporary).write_bytes(stream.getvalue())
    else:
        raise OutputError(f"No plant can be written to '{path}'.", advice=f"Choose {' or '.join(FORMATS)}.")
    return file


def _smooth(description: Description) -> tuple[Description, list[str]]:
    """Return the description without Coulomb friction, which has no slope at rest, and what was left out."""
    changed = []
    for effect in description.effect:
        dry = [p.name for p in effect.parameters() if p.name.endswith(".coulomb") and p.value != 0.0]
        if dry:
            changed.append(effect.with_values(dict.fromkeys(dry, 0.0)))
    notes = [f"Coulomb friction left out: {', '.join(e.name for e in changed)}"] if changed else []
    return (description.with_effects(*changed) if changed else description), notes


def _draw_parameters(estimate: Estimate, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return draws (count, n) of the parameters, Gaussian; one without a standard deviation stays."""
    sigma = np.where(np.isfinite(estimate.sigmas), estimate.sigmas, 0.0)
    covariance = np.diag(sigma**2) if estimate.covariance is None else np.array(estimate.covariance)
    covariance = np.where(np.isfinite(covariance), covariance, 0.0)
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    return estimate.values + rng.standard_normal((count, len(values))) @ spread.T


def _linearise(model: SpacecraftModel, name: str, notes: Sequence[str]) -> LinearPlant:
    q0, nv = model.home, model.nv
    inputs, input_units, columns = _inputs(model)
    still, tau = np.zeros(nv), np.zeros(nv)
    pull = model.acceleration(0.0, q0, still, tau)
    by_input = np.array([model.acceleration(0.0, q0, still, x) - pull for x in columns.T]).T.reshape(nv, -1)
    notes = list(notes)
    if np.abs(pull).max(initial=0.0) > 1e-9:
        held, *_ = np.linalg.lstsq(by_input, -pull, rcond=None)
        tau = columns @ held
        left = np.abs(model.acceleration(0.0, q0, still, tau)).max()
        if left > 1e-6 * max(1.0, np.abs(pull).max()):
            raise ControlError(
                f"'{name}' cannot rest at home: it accelerates by {left:.3g} whatever its inputs.",
                advice="Linearise it without gravity, or where its springs are at rest.",
            )
        constant = ", ".join(f"{n} = {x:.6g}" for n, x in zip(inputs, held, strict=True) if x)
        notes.append(f"about constant inputs {constant}")
    by_position, by_rate = np.zeros((nv, nv)), np.zeros((nv, nv))
    for k in range(nv):
        way = np.zeros(nv)
        way[k] = STEP
        at = [(s, pin.integrate(model.pin, q0, s * way)) for s in (-2, -1, 1, 2)]
        by_position[:, k] = _slope([model.acceleration(0.0, q, still, tau) for _, q in at])
        by_rate[:, k] = _slope([model.acceleration(0.0, q0, s * way, tau) for s, _ in at])
    names, units, scale = _coordinates(model)
    by_position = by_position * (scale[:, None] / scale)
    by_rate = by_rate * (scale[:, None] / scale)
    a = np.block([[np.zeros((nv, nv)), np.eye(nv)], [by_position, by_rate]])
    b = np.vstack([np.zeros((nv, columns.shape[1])), scale[:, None] * by_input])
    states, units = (*names, *(f"{n} rate" for n in names)), (*units, *(f"{u}/s" for u in units))
    return LinearPlant(name, a, b, states, units, inputs, input_units, notes=tuple(notes))


def _slope(values: list[np.ndarray]) -> np.ndarray:
    """Return the derivative from values at -2, -1, 1 and 2 steps."""
    return (values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * STEP)


def _inputs(model: SpacecraftModel) -> tuple[tuple[str, ...], tuple[str, ...], np.ndarray]:
    """Return names, units and generalised forces (nv, m) of the inputs."""
    names, units, columns = [], [], []
    if model.free:
        names += [f"{what}.{axis}" for what in ("force", "torque") for axis in AXES]
        units += [*3 * ("N",), *3 * ("N m",)]
        columns += [model.body_force(x[:3], x[3:]) for x in np.eye(6)]
    for group, what in ((model.wheels, "wheel torque"), (model.arm_joints, "joint torque")):
        for name, j, v in zip(group.names, group.joints, group.v, strict=True):
            slides = model.pin.joints[int(j)].shortname().startswith("JointModelP")
            names.append(f"{name} {'force' if slides else what}")
            units.append("N" if slides else "N m")
            columns.append(np.eye(model.nv)[int(v)])
    return tuple(names), tuple(units), np.array(columns).T.reshape(model.nv, -1)


def _coordinates(model: SpacecraftModel) -> tuple[list[str], list[str], np.ndarray]:
    """Return name and unit of every coordinate, and what it is per coordinate of the model (nv,)."""
    names, units = [""] * model.nv, ["rad"] * model.nv
    scale = np.ones(model.nv)
    for j in range(1, model.pin.njoints):
        joint = model.pin.joints[j]
        label = "bus" if j == 1 and model.free else model.pin.names[j]
        own = range(joint.idx_v, joint.idx_v + joint.nv)
        if joint.nv == 6:
            for k, i in enumerate(own):
                names[i] = f"{label}.{'position' if k < 3 else 'rotation'}.{AXES[k % 3]}"
                units[i] = "m" if k < 3 else "rad"
        else:
            slides = joint.shortname().removeprefix("JointModel").startswith(("P", "Translation"))
            for k, i in enumerate(own):
                names[i] = label if joint.nv == 1 else f"{label}.{AXES[k]}"
                units[i] = "m" if slides else "rad"
    for i, factor in zip(model.modes.v, model.mode_scale, strict=True):
        scale[int(i)], units[int(i)] = float(factor), "kg^0.5 m"
    return names, units, scale
