"""How a motion begins where no sensor reads it: parameters of the search, not of the filter's first state.

A filter is linear about the state that it begins with. Of an attitude, a rate or a wheel's speed that nothing
reads this may be far off, and what it takes for knowledge then is none: momentum of wheels times rate of the
bus is a product of two unknowns. As parameters, the filter is linear about where the search has come to.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.estimation.flight import Flight
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.estimation.problem import Belief

UNREAD = 0.005  # [rad, rad/s] of the bus, or of what wheels turn it by, beyond which nothing has read it
KNOWN_SHARE = 1e-6  # of its standard deviation, what is left of it to the filter
START = "start."


def with_unread_start(flight: Flight) -> tuple[Flight, list[Unknown]]:
    """Return a flight that begins as the search says where nothing reads how, and these parameters.

    They are called ``<label>: start.<attitude|rate>.<axis>`` of the bus and ``<label>: start.<wheel>``, and
    are changes of the state that the flight begins with, in its tangent.
    """
    begin, model = flight.problem.begin, flight.model
    if begin is None or not model.free:
        return flight, []
    nv, sigma = model.nv, np.sqrt(begin.covariance.diagonal())
    mass = pin.crba(model.pin, model.pin.createData(), model.home).diagonal()
    names = {3 + i: (f"attitude.{axis}", "rad") for i, axis in enumerate("xyz")}
    names |= {nv + 3 + i: (f"rate.{axis}", "rad/s") for i, axis in enumerate("xyz")}
    far = {k: UNREAD for k in names}
    for name, v in zip(model.wheels.names, model.wheels.v, strict=True):
        names[nv + int(v)] = name, "rad/s"
        far[nv + int(v)] = UNREAD * float(mass[3:6].min() / mass[v])
    found, covariance = [], begin.covariance.copy()
    for k, (name, unit) in names.items():
        if sigma[k] > far[k]:
            label = f"{flight.label}: {START}{name}"
            found.append(Unknown(label, "start", unit, 0.0, float(sigma[k]), float(sigma[k]), column=k))
            covariance[k], covariance[:, k] = 0.0, 0.0
            covariance[k, k] = (KNOWN_SHARE * sigma[k]) ** 2
    problem = replace(flight.problem, begin=replace(begin, covariance=covariance))
    return (replace(flight, problem=problem) if found else flight), found


def initial_knowledge(point: Point, flight: Flight) -> Belief | None:
    """Return what is known of the state that a flight begins with at a point."""
    begin = flight.problem.begin
    change = _change(point.for_recording(flight.label), flight)
    if begin is None or not change.any():
        return begin
    nv = flight.model.nv
    return replace(begin, q=pin.integrate(flight.model.pin, begin.q, change[:nv]), v=begin.v + change[nv:])


def derivative(here: Point, flight: Flight, unknown: Unknown) -> np.ndarray:
    """Return how the state (2 nv,) at the first sample changes by an unknown, at the point of the flight."""
    out = np.zeros(2 * flight.model.nv)
    out[unknown.column] = 1.0
    if unknown.column < flight.model.nv:  # turns one after the other are not turns by their sum
        out[3:6] = pin.Jexp3(_change(here, flight)[3:6])[:, unknown.column - 3]
    return out


def _change(here: Point, flight: Flight) -> np.ndarray:
    nv = flight.model.nv
    out = np.zeros(2 * nv)
    for name, value in here.biases.items():
        if name.startswith(START):
            kind, _, axis = name.removeprefix(START).rpartition(".")
            if kind in ("attitude", "rate") and axis in "xyz":
                out["xyz".index(axis) + (3 if kind == "attitude" else nv + 3)] = value
            else:
                out[nv + flight.model.wheels.v[flight.model.wheels.names.index(name.removeprefix(START))]] = (
                    value
                )
    return out
