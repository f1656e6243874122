"""Is what drives a flight recorded on its true scale? One scale of it, freed at the maximum."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.effects import SensorScale, ThrusterGain
from smsid.effects.base import Effect
from smsid.errors import SmsidError
from smsid.estimation._normal_equations import NormalEquations, normal_equations, objective_of
from smsid.estimation.flight import Flight
from smsid.estimation.input_hold import input_channels
from smsid.estimation.unknowns import effect_unknown

KNOWN_TO = 0.01  # relative error of a scale that thrusters and tachometers may have
APART, LEAST = 6.0, 0.05  # standard deviations, and relative error, from which a scale is wrong
TOLD_BELOW = 0.1  # standard deviation of a scale above which the recordings do not tell it
LEAST_LEFT = 0.01  # share of what a scale does that no other parameter makes up for: no model is better below
RIVAL_SHARE = 0.5  # share of the best one's chi-squared from which another scale may be what is wrong


@dataclass(frozen=True)
class ScaleConflict:
    """Channels of which one seems to be recorded on a wrong scale, the likeliest first.

    ``scales`` are (channel, what is recorded over what is true, to first order).
    """

    scales: tuple[tuple[str, float], ...]

    @property
    def size(self) -> float:
        """The error in standard deviations of what is known of a scale."""
        return abs(self.scales[0][1] - 1.0) / KNOWN_TO

    @property
    def sentence(self) -> str:
        """The conflict in a sentence."""
        seem = " or ".join(f"'{c}' about {x:.2g} times" for c, x in self.scales)
        return (
            f"The recordings contradict the scale of what drives them: recorded is {seem} what acts. Correct "
            "it in the mapping (or the wheels' inertia, the thrust); to estimate it, list a `thruster_gain` "
            "or `sensor_scale`."
        )


def scale_conflict(
    found: NormalEquations, flights: Sequence[Flight], widening: float = 1.0
) -> tuple[ScaleConflict | None, tuple[str, ...]]:
    """Return the scale that recordings contradict at a maximum, if any, and channels whose scale none tells.

    A Gauss-Newton step of all parameters and one scale more: the score test of that scale (Rao). Standard
    deviations are ``widening`` times those of the stated noise.
    """
    drives = dict(_drives(flights))
    effects = [e for own in drives.values() for e in own]
    added = [effect_unknown(p) for e in effects for p in e.parameters()]
    if not added:
        return None, ()
    described = found.point.description.with_effects(*effects)
    unknowns = [*found.unknowns, *(replace(u, sigma=1.0, scale=KNOWN_TO) for u in added)]
    whole = normal_equations(replace(found.point, description=described), unknowns, flights)
    size, first, wrong, untold = len(found.unknowns), len(found.unknowns), [], []
    for channel, own in drives.items():
        count = sum(len(e.parameters()) for e in own)
        joined = np.zeros((len(unknowns), size + 1))  # all components by one factor
        joined[:size, :size], joined[first : first + count, size] = np.eye(size), 1.0
        first += count
        gram = joined.T @ whole.gram @ joined
        covariance = np.linalg.inv(gram)
        left = 1.0 / np.sqrt(gram[size, size] * covariance[size, size])
        error = KNOWN_TO * float((covariance @ joined.T @ whole.slope)[size])
        sigma = KNOWN_TO * float(np.sqrt(covariance[size, size])) * widening
        if sigma > TOLD_BELOW or left < LEAST_LEFT:
            untold.append(channel)
        elif abs(error) > max(APART * sigma, LEAST):
            ratio = 1.0 / (1.0 + error) if channel.startswith("command.") else 1.0 + error
            step = joined @ (covariance @ joined.T @ whole.slope)
            wrong.append(((error / sigma) ** 2, (channel, ratio), step))
    wrong.sort(key=lambda x: -x[0])
    least = 0.5 * (APART * widening) ** 2
    if not any(_is_gained(whole, flights, step, least) for _, _, step in wrong):
        return None, tuple(untold)
    likely = tuple(scale for chi2, scale, _ in wrong if chi2 > RIVAL_SHARE * wrong[0][0])
    return ScaleConflict(likely), tuple(untold)


def _is_gained(whole: NormalEquations, flights: Sequence[Flight], step: np.ndarray, least: float) -> bool:
    """Whether the log-posterior rises by so much along a step (m,), in scales: then its maximum does, too.

    A slope alone may promise what bends away: some parameters are told by no straight line.
    """
    for share in (1.0, 0.5):
        try:
            moved = whole.point.moved(whole.unknowns, share * step * whole.scales)
            if whole.objective - objective_of(moved, whole.unknowns, flights) > least:
                return True
        except SmsidError:
            continue
    return False


def _drives(flights: Sequence[Flight]) -> Iterator[tuple[str, list[Effect]]]:
    """Yield thrust and rates of wheels where they drive a flight, with the effects that scale them."""
    for flight in flights:
        model, recording = flight.model, flight.problem.recording
        thrust = input_channels(model, recording)
        if "force" in thrust and np.any(recording[thrust["force"]]):
            yield thrust["force"], [ThrusterGain(name="scale_of_force")]
        for channel in (thrust[c] for c in ("thruster", "thruster_force") if c in thrust):
            names = [t.name for t in model.description.thruster]
            yield channel, [ThrusterGain(name=f"scale_of_{n}", thruster=n, gain=0.0) for n in names]
        for block in flight.problem.data.blocks:
            count = len(model.wheels)
            if block.quantity == "wheel_rate" and "measured" in {
                flight.drives[n] for n in model.wheels.names
            }:
                at = {"sensor": block.sensor.name, "quantity": block.quantity, "error": 0.0}
                own = [SensorScale(name=f"scale_of_wheel_{k}", component=k, **at) for k in range(count)]
                yield block.channel, [*own]
