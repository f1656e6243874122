"""Simulation: adaptive with dense output, and fixed-step for closed loops."""

from typing import TYPE_CHECKING

from smsid._callable import make_callable
from smsid._lazy import lazy_names

if TYPE_CHECKING:
    from smsid.inputs.changed import Delayed, Switched
    from smsid.inputs.inputs import Inputs, JointMotion
    from smsid.inputs.signals import Constant, Fourier, PiecewiseConstant, Sampled, Signal, Sum
    from smsid.simulate.fixed_step import simulate_closed_loop
    from smsid.simulate.integrate import Tolerance, simulate
    from smsid.simulate.trajectory import States, Trajectory
    from smsid.simulate.truth import truth_of

__all__ = [
    "Constant",
    "Delayed",
    "Fourier",
    "Inputs",
    "JointMotion",
    "PiecewiseConstant",
    "Sampled",
    "Signal",
    "States",
    "Sum",
    "Switched",
    "Tolerance",
    "Trajectory",
    "simulate",
    "simulate_closed_loop",
    "truth_of",
]

make_callable(__name__)  # smsid.simulate(...) is that of smsid.api
_, __getattr__ = lazy_names(__name__)
