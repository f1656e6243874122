"""What drives the motion between samples: applied forces over short steps, from commands as they came."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from smsid.estimation.filter_pass import AppliedForces
from smsid.estimation.input_hold import COMMANDS, has_pulses, limits, means, pulsed_thrust, unevenness
from smsid.estimation.process_model import ProcessModel
from smsid.inputs.signals import Constant, Sampled, Signal
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import Inputs

MEMORY = 2.0  # [s] of commands that are remembered: more than any delay


def applied_forces(plant: ProcessModel, inputs: Inputs, edges: np.ndarray, substep: float) -> AppliedForces:
    """Return the applied generalised forces between edges (n + 1,) [s] and at them, in substeps."""
    signal = plant.applied(inputs)
    widths = np.diff(edges)
    n = max(1, int(np.ceil(float(widths.max(initial=substep)) / substep - 1e-9)))
    n += n % 2  # the middle of an interval is an end of a step
    if not len(widths):
        nothing = np.zeros((0, n, plant.nv))
        return AppliedForces(nothing, nothing[:, 0], limits(signal, edges, "right"), nothing)
    parts = np.linspace(0.0, 1.0, n + 1)[:-1]
    fine = np.append((edges[:-1, None] + widths[:, None] * parts).ravel(), edges[-1])
    shape = (len(widths), n, plant.nv)
    mean = means(signal, fine).reshape(shape)
    rise = -6.0 * unevenness(signal, fine) / np.diff(fine)[:, None] ** 2
    return AppliedForces(mean, mean.mean(axis=1), limits(signal, edges, "right"), rise.reshape(shape))


class CommandMemory:
    """The last commands by channel, as inputs of a simulation."""

    def __init__(self, model: SpacecraftModel, hold: str) -> None:
        self.model = model
        self.degree = 0 if hold == "held" else 1
        sizes = {"force": 3, "torque": 3} if model.free else {}
        sizes |= {"wheel_torque": len(model.wheels), "joint_torque": len(model.arm_joints)}
        thrusters = model.description.thruster
        sizes |= {"thruster": len(thrusters), "thruster_force": len(thrusters)}
        self.full = np.array([t.force for t in thrusters], dtype=float)
        self.sizes = {COMMANDS[k]: n for k, n in sizes.items() if n}
        self.memory: dict[str, deque[tuple[float, np.ndarray]]] = {c: deque() for c in self.sizes}

    def add(self, time: float, channels: Mapping[str, np.ndarray]) -> None:
        """Remember the commands (k,) of a sample by channel."""
        for channel, own in self.memory.items():
            value = channels.get(channel)
            if value is not None:
                own.append((time, value))

    def forget(self, before: float) -> None:
        """Forget what was commanded earlier than `MEMORY` before a time [s] up to which all is taken in."""
        for own in self.memory.values():
            while len(own) > 2 and own[1][0] < before - MEMORY:
                own.popleft()

    def inputs(self) -> Inputs:
        """Return what is remembered; what was never commanded is zero."""
        signals: dict[str, Signal] = {}
        for field, channel in COMMANDS.items():
            own: Sequence[tuple[float, np.ndarray]] = self.memory.get(channel, ())
            if not own:
                continue
            if field == "thruster_force":  # it says what the share of full thrust says
                field, own = "thruster", [(t, x / self.full) for t, x in own]
            signals[field] = self._thrust(own, channel) if field == "thruster" else self._signal(own)
        return Inputs(**signals)  # type: ignore[arg-type]

    def _thrust(self, samples: Sequence[tuple[float, np.ndarray]], channel: str) -> Signal:
        if len(samples) < 2 or not has_pulses(self.model):
            return self._signal(samples)
        times, shares = (np.array(x) for x in zip(*samples, strict=True))
        return pulsed_thrust(self.model, times, shares, channel)

    def _signal(self, samples: Sequence[tuple[float, np.ndarray]]) -> Signal:
        if len(samples) == 1:
            return Constant(samples[0][1])
        times = np.array([t for t, _ in samples])
        return Sampled.from_samples(times, np.array([x for _, x in samples]), self.degree)
