"""A designed controller as JSON: gains, weights with their origin, the H-infinity term, what it promises."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from smsid._files import atomic_write
from smsid._reading import SCHEMA_VERSION, reading_document
from smsid._version import __version__
from smsid.control.design import Design
from smsid.control.gains import Gains
from smsid.control.statespace import StateSpace
from smsid.errors import ControlError


def controller_document(made: Design) -> dict[str, Any]:
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
    }
    document["model"] = {
        "bodies": {
            name: [float(x) for x in inertia.toDynamicParameters()]
            for name, inertia in zip(
                list(made.dynamics.pin.names)[1:], list(made.dynamics.pin.inertias)[1:], strict=True
            )
        },
        "unit": "m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz in the joint's frame, slosh and appendages at rest: SI",
        "identified": list(made.identified.applied) if made.identified else [],
        "as_described": list(made.identified.left) if made.identified else [],
    }
    document["poles"] = [
        {
            "mode": p.name,
            "value": [p.value.real, p.value.imag],
            "unit": "rad/s",
            "damping": p.damping,
            "flag": p.flag,
        }
        for p in made.poles
    ]
    if made.robustness is not None:
        document["robustness"] = asdict(made.robustness)
    if made.tuning is not None:
        document["natural_frequencies"] = [{**asdict(m), "unit": "rad/s"} for m in made.tuning.modes]
    return document


def save_controller(made: Design, path: str | os.PathLike[str]) -> None:
    """Write a design as JSON, whole or not at all."""
    document = controller_document(made)
    atomic_write(Path(path), json.dumps(document, indent=1, allow_nan=False) + "\n")


def load_controller(path: str | os.PathLike[str]) -> tuple[Gains, StateSpace]:
    """Return gains and H-infinity term of a saved design; raises `ControlError` naming what is wrong."""
    with reading_document(path, "controller", "control", ControlError) as document:
        found = Gains(np.array(document["K_P"]["value"]), np.array(document["K_D"]["value"]))
        a, b, c, d = (np.array(document["u_inf"][k]) for k in "abcd")
        return found, StateSpace(a, b, c, d)
