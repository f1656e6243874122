"""A designed controller as JSON: gains, weights with their origin, the H-infinity term, what it promises."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from smsid._files import atomic_write
from smsid._reading import SCHEMA_VERSION, reading_document
from smsid._version import __version__
from smsid.control._statespace import StateSpace
from smsid.control.design import ControllerDesign, DesignRequest
from smsid.control.gains import Gains
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics
from smsid.control.trajectory import Motion
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.errors import ControlError
from smsid.model.spacecraft import SpacecraftModel


def controller_document(made: ControllerDesign) -> dict[str, Any]:
    """Return the document of a design."""
    term, coordinates = made.term, made.coordinates
    w = term.weights
    document: dict[str, Any] = {
        "schema": SCHEMA_VERSION,
        "kind": "controller",
        "smsid": __version__,
        "description": made.description,
        "law": "Q_c = J_c^-T (H (qdd_d + K_D de + K_P e - u_inf) + c)",
        "coordinates": list(coordinates),
        "rate": {"value": made.rate, "unit": "Hz"},
        "K_P": {"value": term.gains.proportional.tolist(), "unit": "1/s^2"},
        "K_D": {"value": term.gains.derivative.tolist(), "unit": "1/s"},
        "weights": {
            "disturbance": {"value": w.disturbance.tolist(), "unit": "rad/s^2"},
            "angle_noise": {"value": w.angle_noise.tolist(), "unit": "rad"},
            "rate_noise": {"value": w.rate_noise.tolist(), "unit": "rad/s"},
            "uncertainty": {"value": w.uncertainty, "unit": "1"},
            "crossover": {"value": w.crossover, "unit": "rad/s"},
            "integral": {"value": w.integral, "unit": "rad/s"},
            "origin": list(w.origin),
        },
        "u_inf": {
            "input": "e, de [rad, rad/s]",
            "output": "u_inf [rad/s^2]",
            **{k: getattr(term.controller, k).tolist() for k in "abcd"},
        },
        "gamma": term.gamma,
        "blocks": [
            {
                "coordinates": [coordinates[k] for k in b.coordinates],
                "gamma": b.synthesis.norm,
                "error_bound": {"value": b.error.tolist(), "unit": "rad"},
                "crossover": {"value": b.crossover, "unit": "rad/s"},
                "sensitivity_peak": b.sensitivity,
                "complementary_peak": b.complementary,
                "gain_margin": [x if math.isfinite(x) else None for x in b.gain_margin],
                "phase_margin": {"value": b.phase_margin, "unit": "deg"},
                "poles": {"value": [[p.real, p.imag] for p in b.poles.tolist()], "unit": "rad/s"},
            }
            for b in term.blocks
        ],
        "model": {
            "bodies": {
                name: [float(x) for x in inertia.toDynamicParameters()]
                for name, inertia in made.dynamics.bodies.items()
            },
            "unit": "m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz in the joint's frame, "
            "slosh and appendages at rest: SI",
            "identified": list(made.identified.applied) if made.identified else [],
            "as_described": list(made.identified.left) if made.identified else [],
        },
        "poles": [
            {
                "mode": p.name,
                "value": [p.value.real, p.value.imag],
                "unit": "rad/s",
                "damping": p.damping,
                "flag": p.flag,
            }
            for p in made.poles
        ],
    }
    if made.robustness is not None:
        document["robustness"] = asdict(made.robustness)
    if made.tuning is not None:
        document["natural_frequencies"] = [{**asdict(m), "unit": "rad/s"} for m in made.tuning.modes]
    return document


def save_controller(made: ControllerDesign, path: str | os.PathLike[str]) -> None:
    """Write a design as JSON, whole or not at all."""
    document = controller_document(made)
    atomic_write(Path(path), json.dumps(document, indent=1, allow_nan=False) + "\n")


@dataclass(frozen=True)
class SavedController:
    """A design as it stands in its file, of the spacecraft ``description``, to be called at ``rate`` [Hz].

    ``term`` is the H-infinity term from (e, de) (2 n,) to u_inf (n,); ``bodies`` holds the inertial
    parameters (10,) of the controller's model by joint: m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, SI, in the
    joint's frame.
    """

    description: str
    rate: float
    gains: Gains
    term: StateSpace
    bodies: Mapping[str, np.ndarray]

    def controller(self, model: SpacecraftModel, reference: Motion, period: float) -> ModelBasedController:
        """Return the controller of a spacecraft along a reference, called every ``period`` [s].

        Raises `ControlError` when it was made for another spacecraft.
        """
        dynamics = ReducedDynamics(model)
        described = dynamics.bodies
        if model.description.name != self.description or set(described) != set(self.bodies):
            raise ControlError(
                f"The controller was designed for '{self.description}' with {', '.join(self.bodies)}; "
                f"'{model.description.name}' has {', '.join(described)}.",
                advice="Design one for this description by `smsid control`.",
            )
        inertias = [
            pinocchio_inertia(self.bodies[name]) if self.bodies[name][0] > 0.0 else inertia
            for name, inertia in described.items()
        ]
        own = dynamics.with_inertias(inertias)
        return ModelBasedController(own, self.gains, reference, robust=self.term, period=period)


def load_controller(path: str | os.PathLike[str]) -> SavedController:
    """Return a saved design; raises `ControlError` naming what is wrong.

    Files of versions that did not write the rate were designed for 100 Hz unless they were told otherwise.
    """
    with reading_document(path, "controller", "control", ControlError) as document:
        found = Gains(np.array(document["K_P"]["value"]), np.array(document["K_D"]["value"]))
        a, b, c, d = (np.array(document["u_inf"][k]) for k in "abcd")
        rate = float(document["rate"]["value"]) if "rate" in document else DesignRequest().rate
        bodies = {name: np.array(theta, dtype=float) for name, theta in document["model"]["bodies"].items()}
        return SavedController(document["description"], rate, found, StateSpace(a, b, c, d), bodies)
