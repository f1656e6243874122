"""Hidden states of flights as a recording: slosh, modes, disturbances, biases, with standard deviations."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from smsid.errors import SmsidError
from smsid.estimation._normal_equations import NormalEquations, problem_at
from smsid.estimation._smoother import SmoothedStates, smoothed_states
from smsid.estimation.flight import Flight
from smsid.estimation.identify_flights import FlightEstimate
from smsid.estimation.parameter_vector import Point
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

DIFFERENCE_STEP = 0.1  # standard deviations of the parameters by which they are moved
SOURCE = "smoothed"


@dataclass(frozen=True)
class _HiddenChannel:
    """A channel: its name, values (N, k) and standard deviations (N, k), those of states alone."""

    source: str
    quantity: str
    values: np.ndarray
    sigma: np.ndarray


def hidden_states(found: FlightEstimate, *, parameters: bool = True) -> Recording:
    """Return what no sensor saw of the flights an estimate is from, given all of their samples.

    Channels are those of the truth of a simulation with the source ``smoothed`` instead (of several tanks
    ``smoothed_<tank>``): slosh_position, slosh_velocity, modal_position, modal_velocity; further force and
    torque [N, N m] where the estimate has unrecorded ones, and ``bias_<sensor>.<quantity>``, constant. The
    standard deviation of each is in the same channel of the source with ``_sigma`` at its end. Of several
    flights sources begin with the flight's name. The clock is that of the flight's samples.

    Args:
        found: as `identify_flights` gives it.
        parameters: whether the standard deviations have the parameters' uncertainty in them, which takes a
            run of the filter for each; without, parameters count as exact.

    Raises:
        SimulationError: the filter loses a recording.
        SmsidError: no flight has a hidden state.
    """
    channels: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    several = len({f.label for f in found.flights}) > 1
    modes: tuple[str, ...] = ()
    with threadpool_limits(limits=1, user_api="blas"):
        for flight in found.flights:
            lead = re.sub(r"\W+", "_", flight.label).strip("_") + "_" if several else ""
            modes = found.found.point.model().modes.names
            for shown in _of_flight(found, flight, parameters):
                time = flight.problem.own_times
                for source, values in ((shown.source, shown.values), (f"{shown.source}_sigma", shown.sigma)):
                    name = f"{lead}{source}.{shown.quantity}"
                    before = channels.get(name, (time[:0], values[:0]))  # another piece between gaps
                    channels[name] = (np.append(before[0], time), np.concatenate([before[1], values]))
    if not channels:
        raise SmsidError(
            "Nothing is hidden in these flights: no slosh, mode, unrecorded force or bias.",
            advice="List what there is as effects of the description.",
        )
    return Recording.from_arrays(
        None,
        channels,
        labels={"mode": list(modes)} if any("modal_" in c for c in channels) else None,
        name=f"{found.estimate.description}: hidden states",
        provenance={
            "hidden_states": {"method": "modified Bryson-Frazier", "parameters_uncertain": parameters}
        },
    )


def _of_flight(found: FlightEstimate, flight: Flight, parameters: bool) -> Iterator[_HiddenChannel]:
    equations = found.found
    model, smoothed = _smooth_flight(equations.point, flight)
    shown = list(_states(model, smoothed, flight))
    if parameters and shown:
        variance = [x.sigma**2 for x in shown]
        for moved, size in _neighbours(equations):
            other = list(_states(*_smooth_flight(moved, flight), flight))
            for v, a, b in zip(variance, shown, other, strict=True):
                v += ((b.values - a.values) / size) ** 2 * found.quality.widening**2
        shown = [
            _HiddenChannel(x.source, x.quantity, x.values, np.sqrt(v))
            for x, v in zip(shown, variance, strict=True)
        ]
    yield from shown
    yield from _biases(found, flight)


def _smooth_flight(point: Point, flight: Flight) -> tuple[SpacecraftModel, SmoothedStates]:
    """Return the model at a point and the states of a flight under it, with sensors as they are there."""
    model = point.model()
    return model, smoothed_states(model, problem_at(point, flight))


def _neighbours(equations: NormalEquations) -> Iterator[tuple[Point, float]]:
    """Yield points a little off along independent directions of the parameters' uncertainty, and how far."""
    root = np.linalg.cholesky(np.linalg.inv(equations.gram)).T
    for direction in root:
        for size in (DIFFERENCE_STEP, -DIFFERENCE_STEP):
            try:
                moved = equations.point.moved(equations.unknowns, size * direction * equations.scales)
                moved.model()
            except SmsidError:
                if size < 0.0:
                    raise
                continue
            yield moved, size
            break


def _states(model: SpacecraftModel, found: SmoothedStates, flight: Flight) -> Iterator[_HiddenChannel]:
    s, nv = found.states, model.nv
    sigma = np.sqrt(np.maximum(np.diagonal(found.covariance, axis1=1, axis2=2), 0.0))
    for joint in model.slosh:
        source = SOURCE if len(model.slosh) == 1 else f"{SOURCE}_{joint.name}"
        index = np.arange(nv)[joint.v]
        yield _HiddenChannel(source, "slosh_position", s.q[:, joint.q], sigma[:, index])
        yield _HiddenChannel(source, "slosh_velocity", s.v[:, joint.v], sigma[:, nv + index])
    if len(model.modes):
        scale, index = model.mode_scale, np.asarray(model.modes.v)
        yield _HiddenChannel(SOURCE, "modal_position", s.q[:, model.modes.q] * scale, sigma[:, index] * scale)
        yield _HiddenChannel(
            SOURCE, "modal_velocity", s.v[:, model.modes.v] * scale, sigma[:, nv + index] * scale
        )
    acts = [u.dof for u in flight.problem.unknown_inputs]
    for first, quantity in ((0, "force"), (3, "torque")):
        if model.free and all(first + i in acts for i in range(3)):
            own = [acts.index(first + i) for i in range(3)]
            yield _HiddenChannel(SOURCE, quantity, found.unknown[:, own], sigma[:, [2 * nv + i for i in own]])


def _biases(found: FlightEstimate, flight: Flight) -> Iterator[_HiddenChannel]:
    """Yield the sensors' biases of a flight, constant, as its estimate has them."""
    start, samples = f"{flight.label}: ", len(flight.problem.data.times)
    own: dict[str, dict[str, tuple[float, float]]] = {}
    for p in found.estimate.parameters:
        if p.name.startswith(start) and ".bias." in p.name:
            channel, _, axis = p.name.removeprefix(start).partition(".bias.")
            own.setdefault(channel, {})[axis] = (p.value, p.sigma)
    for channel, axes in own.items():
        sensor, _, quantity = channel.partition(".")
        if set(axes) == set("xyz"):
            values, sigma = (np.tile([axes[a][k] for a in "xyz"], (samples, 1)) for k in (0, 1))
            yield _HiddenChannel(f"bias_{sensor}", quantity, values, sigma)
