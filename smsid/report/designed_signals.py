"""What a designed experiment commands, component by component, beside its reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from smsid.experiments import Experiment
from smsid.experiments.schema import Profile
from smsid.inputs.signals import Signal, sample
from smsid.model.spacecraft import SpacecraftModel
from smsid.report.axes import Axis
from smsid.report.model import Figure, Grid
from smsid.report.plot import Curve, Plot

POINTS = 1200
HEIGHT = 150


def signal_grids(model: SpacecraftModel, experiment: Experiment, reference: Experiment) -> tuple[Grid, ...]:
    """Return a grid of small figures per kind of command; components that stay zero in both are left out."""
    out = []
    for key, title, unit, names in _kinds(model):
        now, then = getattr(experiment, key), getattr(reference, key)
        figures = _figures(key, names, unit, (now, experiment.duration), (then, reference.duration))
        if figures:
            out.append(Grid(title, figures))
    return tuple(out)


def signal_points(signal: Signal, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (N,) and values (N, size) to draw a signal from 0 to ``duration`` [s], jumps upright."""
    jumps = np.array([t for t in signal.breakpoints if 0.0 < t < duration])
    before = np.nextafter(jumps, 0.0)
    times = np.unique(np.concatenate([np.linspace(0.0, duration, POINTS), before, jumps]))
    return times, sample(signal, times)


def _kinds(model: SpacecraftModel) -> Iterator[tuple[str, str, str, Sequence[str]]]:
    axes = [f"along {a}" for a in "xyz"]
    yield "force", "Thrust, body axes", "N", axes
    yield "torque", "Torque on the bus, body axes", "N m", [f"about {a}" for a in "xyz"]
    yield "wheel_torque", "Torques of the wheels", "N m", model.wheels.names
    yield "joint_torque", "Torques of the joints", "N m", model.arm_joints.names
    yield "joint_motion", "Angles of the joints", "rad", model.arm_joints.names


Timed = tuple[Profile | None, float]


def _figures(key: str, names: Sequence[str], unit: str, now: Timed, then: Timed) -> tuple[Figure, ...]:
    curves = []
    kinds = ((then, "before", 2, "thin"), (now, "designed", 0, "line"))
    for (profile, duration), label, colour, style in kinds:
        if profile is not None:
            curves.append((label, colour, style, *signal_points(profile.signal(), duration)))
    out = []
    for k, name in enumerate(names):
        own = [Curve(name_, t, x[:, k], hue, style) for name_, hue, style, t, x in curves if x[:, k].any()]
        if not own:
            continue
        x = Axis.over("time [s]", [c.x for c in own], room=0.0, count=6)
        y = Axis.over(unit, [c.y for c in own], count=4)
        body = Plot(x, y, own, f"{name} over time, designed and before", HEIGHT)
        out.append(Figure(f"{key}-{k}", name, body))
    return tuple(out)
