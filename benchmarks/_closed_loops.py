"""Closed loops of the speed benchmark: the same flight under the controller, and with its torques held."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from _common import interleaved, spread

from smsid.control.closed_loop import starting_point, track
from smsid.control.gains import gains
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics
from smsid.control.robust_term import design_robust_term
from smsid.control.trajectory import Reference, trapezoid
from smsid.control.weights import weights_from_level
from smsid.kernel.jit import SWITCH
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import Inputs, Sampled, simulate

DURATION = 80.0


def law_of(model: SpacecraftModel, rate: float) -> ModelBasedController:
    dynamics = ReducedDynamics(model)
    k, noise = gains(dynamics.size, 4.0, 4.0), np.full(dynamics.size, 1e-5)
    wanted = np.full(dynamics.size, 1e-3)
    weights = weights_from_level(
        0.05, wanted, left_out=1e-4, angle_noise=noise, rate_noise=noise, crossover=0.1 * rate
    )
    return ModelBasedController(
        dynamics,
        k,
        Reference(trapezoid(model.joint_angles(model.home))),
        robust=design_robust_term(k, weights),
        period=1.0 / rate,
    )


def closed_loops(model: SpacecraftModel, rounds: int) -> dict[str, Any]:
    """Return seconds of both, compiled and plain, and their ratios, by the controller's rate [Hz]."""
    found = {}
    for rate in (20.0, 100.0):
        law, sensors = law_of(model, rate), model.description.effective_sensors()

        def closed(law=law, rate=rate, sensors=sensors):
            return track(model, law, rate=rate, sensors=sensors, rng=np.random.default_rng(0))

        flown, q0 = closed(), starting_point(model, law)
        held = {
            "wheel_torque": Sampled.from_samples(flown.time, flown.wheel_torque, degree=0),
            "joint_torque": Sampled.from_samples(flown.time, flown.torques[:, 3:], degree=0),
        }

        def opened(q0=q0, held=held):
            return simulate(model, Inputs(**held), DURATION, q0=q0)

        gap = float(np.abs(opened().states(flown.time[-1:]).v[0] - flown.v[-1]).max())
        seconds = interleaved(
            {
                "closed": closed,
                "open": opened,
                "closed, plain": plainly(closed),
                "open, plain": plainly(opened),
            },
            rounds,
        )
        found[f"{rate:g} Hz"] = {
            "seconds_per_simulated_second": {k: spread(s / DURATION) for k, s in seconds.items()},
            "closed_over_open": spread(seconds["closed"] / seconds["open"]),
            "plain_closed_over_compiled": spread(seconds["closed, plain"] / seconds["closed"]),
            "plain_closed_over_plain_open": spread(seconds["closed, plain"] / seconds["open, plain"]),
            "largest_difference_of_the_last_rates": float(f"{gap:.2g}"),
        }
        print(f"closed loop {rate:g} Hz over open:", found[f"{rate:g} Hz"]["closed_over_open"], flush=True)
    return found


def plainly(function: Callable[[], Any]) -> Callable[[], Any]:
    """Return the function without compiled code."""

    def run() -> Any:
        os.environ[SWITCH] = "0"
        try:
            return function()
        finally:
            del os.environ[SWITCH]

    return run
