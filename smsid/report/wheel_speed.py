"""What is left of every equation against the wheels' speed: shown in the map, no part of the verdict."""

from __future__ import annotations

import numpy as np

from smsid.diagnose.blocks import Block
from smsid.diagnose.candidates import EXCITED, least_squares
from smsid.estimation.map_estimate import Fit
from smsid.estimation.sensitivities import propagate
from smsid.simulate.trajectory import States

DEPENDENCE = "wheel speed"


def wheel_speed_tests(found: Fit) -> tuple[Block, ...]:
    """Return the test of every force and torque on the bus and every joint torque against all wheels.

    By wheel the speed W itself, and what turns with the wheel: W^2 times cosine and sine of its angle, as an
    imbalance pulls. Chi-squared with the fitted parameters free; none without wheels.
    """
    model = found.changes.model
    wheels = list(zip(model.wheels.q, model.wheels.v, strict=True))
    if not wheels:
        return ()
    equations = [
        *((f"{what} on the bus along {axis}", i) for i, (what, axis) in enumerate(_bus(model.free))),
        *(
            (f"torque of {n}", int(v))
            for n, v in zip(model.arm_joints.names, model.arm_joints.v, strict=True)
        ),
    ]

    def terms(s: States) -> np.ndarray:
        out = []
        for q, v in wheels:
            angle, speed = s.q[:, q], s.v[:, v]
            out += [speed, speed**2 * np.cos(angle), speed**2 * np.sin(angle)]
        return np.array(out)

    middle, at = terms(found.run.middle), terms(found.run.states)
    out = []
    for where, dof in equations:
        if dof in found.problem.locked:
            continue
        changes = [
            found.changes.force(_on(dof, m, model.nv), _on(dof, a, model.nv))
            for m, a in zip(middle, at, strict=True)
        ]
        (own,) = found.projected([propagate(found.run, changes).reshape(-1, len(changes))])
        raw = np.einsum("ij,ij->j", own.columns, own.columns)
        _, _, ratio, values = least_squares(own.left.T @ own.left, own.left.T @ found.residual, raw)
        out.append(Block(where, DEPENDENCE, ratio, int((values > EXCITED).sum())))
    return tuple(out)


def _bus(free: bool) -> list[tuple[str, str]]:
    return [(what, axis) for what in ("force", "torque") for axis in "xyz"] if free else []


def _on(dof: int, values: np.ndarray, nv: int) -> np.ndarray:
    out = np.zeros((len(values), nv))
    out[:, dof] = values
    return out
