"""From a description and an estimate to a controller, (43) or (46), examined before it flies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid._short_repr import short_repr
from smsid.control._robust import Pole, flexible_plant, refuse_unstable
from smsid.control._uncertain_plant import uncertain_plant
from smsid.control._wheels import WheelLayout
from smsid.control.closed_loop import left_out, sensor_noise, sensor_sigma
from smsid.control.gains import gains
from smsid.control.identified_model import IdentifiedModel, identified_level, identified_model, inertia_at
from smsid.control.reduced import ReducedDynamics
from smsid.control.robust_term import RobustTerm, guarded_term
from smsid.control.robustness import Robustness, robust_stability
from smsid.control.trajectory import PAPER_ACCELERATION, Reference, check_joints, design_motion
from smsid.control.tuning import Demands, TuningResult, natural_modes, tuned_gains
from smsid.control.weights import weights_from_level
from smsid.description.schema import Description
from smsid.errors import ControlError
from smsid.identify.estimate import Estimate
from smsid.model import build_model
from smsid.model.spacecraft import SpacecraftModel

GAINS_BELOW_CROSSOVER = 0.5
"""Largest frequency of tuned gains, relative to the crossover."""
FIRST_GAINS = (1.0, 2.0)
"""Gains at which what slosh and panel do is measured before any are chosen."""


@dataclass(frozen=True)
class DesignRequest:
    """What is asked for: ``gains`` K_P, K_D for all coordinates, or None to choose them.

    ``uncertainty`` states a level instead of the estimate's; ``crossover`` [rad/s], ``rate`` [Hz];
    ``samples`` plants are drawn for the robust analysis.
    """

    gains: tuple[float, float] | None = (4.0, 4.0)
    uncertainty: float | None = None
    crossover: float = 10.0
    rate: float = 100.0
    samples: int = 1000

    def __post_init__(self) -> None:
        """Raise `ControlError` for what no controller can have."""
        positive = {"--crossover": self.crossover, "--rate": self.rate, "--samples": self.samples}
        for name, value in positive.items():
            if not value > 0.0:
                raise ControlError(f"{name} {value} is not positive.", advice="Give a number above 0.")
        if self.uncertainty is not None and not self.uncertainty >= 0.0:
            raise ControlError(
                f"--uncertainty {self.uncertainty} is no share.", advice="Give 0.05 for 5 %, 0 or more."
            )


@short_repr
@dataclass(frozen=True)
class ControllerDesign:
    """A controller: ``dynamics`` its model, ``term`` gains and H-infinity term, and what was found out.

    ``rate`` [Hz] of its calls and ``level``, the uncertainty, are what it is designed for, ``poles`` those of
    the loop with slosh and panel inside, ``robustness`` and ``identified`` None where no estimate was given,
    ``tuning`` where gains were.
    """

    description: str
    coordinates: tuple[str, ...]
    dynamics: ReducedDynamics
    term: RobustTerm
    rate: float
    level: float
    poles: tuple[Pole, ...]
    identified: IdentifiedModel | None
    robustness: Robustness | None
    tuning: TuningResult | None


def design(
    description: Description, estimate: Estimate | None, request: DesignRequest, rng: np.random.Generator
) -> ControllerDesign:
    """Return a design on the identified model (the described one without an estimate).

    The controller's rigid model, slosh and panel in the examined plant, the weights and the modes that gains
    keep clear of all come from the estimate's values and intervals.

    Raises:
        ControlError: no arm, neither estimate nor uncertainty, no intervals, gains that are not positive
            definite, an infeasible design, or one that destabilises slosh or panel.
    """
    if estimate is None and (request.uncertainty is None or request.gains is None):
        raise ControlError(
            "Without an estimate, gains and an uncertainty have to be stated.",
            advice="Pass an estimate, or both.",
        )
    if not build_model(description).arm_joints:
        raise ControlError(
            f"'{description.name}' has no arm, and weights are those of an arm's motion: what it disturbs.",
            advice="Design on a spacecraft with an arm; `smsid.control.pd` takes gains of your own.",
        )
    identified = None if estimate is None else identified_model(description, estimate)
    model = build_model(description) if identified is None else identified.model
    dynamics = ReducedDynamics(model)
    n, home = dynamics.size, model.joint_angles(model.home)
    motion = design_motion(model)
    check_joints(motion, model)
    reference = Reference(motion)
    if request.uncertainty is not None:
        level = request.uncertainty
    else:
        assert identified is not None
        along = [motion.at(t)[0] for t in np.linspace(0.0, motion.duration, 5)]
        level = identified_level(identified, rng, angles=along)
    wanted = np.concatenate([np.zeros(3), np.full(n - 3, PAPER_ACCELERATION)])
    plant = None
    if identified is not None and estimate is not None:
        plant = uncertain_plant(identified, estimate, home)
    inertia, flexible = inertia_at(dynamics, home), flexible_plant(model, home)
    tuning = None
    if request.gains is None:
        assert plant is not None
        passive = left_out(model, gains(n, *FIRST_GAINS), reference, rate=request.rate)
        angle, speed = sensor_sigma(model.description.effective_sensors(), n - 3)
        demands = Demands(
            level * wanted + passive,
            angle,
            speed,
            strength(model, inertia),
            request.rate,
            GAINS_BELOW_CROSSOVER * request.crossover,
        )
        tuning = tuned_gains(flexible, inertia, demands, natural_modes(plant, rng))
        k = tuning.gains
    else:
        k = gains(n, *request.gains)
    angle, speed = sensor_noise(model.description.effective_sensors(), n - 3, request.rate, request.crossover)
    weights = weights_from_level(
        level,
        wanted,
        left_out=left_out(model, k, reference, rate=request.rate),
        angle_noise=angle,
        rate_noise=speed,
        crossover=request.crossover,
        source="stated" if request.uncertainty is not None else "from the estimate's intervals",
    )
    term, poles = guarded_term(flexible, inertia, k, weights)
    refuse_unstable(poles)
    robustness = None
    if plant is not None:
        robustness = robust_stability(
            plant, inertia, k, term.controller, level=level, rng=rng, samples=request.samples
        )
    names = ("roll", "pitch", "yaw", *model.arm_joints.names)
    return ControllerDesign(
        description.name, names, dynamics, term, request.rate, level, poles, identified, robustness, tuning
    )


def strength(model: SpacecraftModel, inertia: np.ndarray) -> np.ndarray:
    """Return the largest accelerations (3 + n,) [rad/s^2] that wheels and joint motors can give."""
    layout = WheelLayout.of(model)
    wheels = np.array(
        [np.min(layout.max_torque / np.maximum(np.abs(layout.inverse[:, k]), 1e-12)) for k in range(3)]
    )
    return np.concatenate([wheels, model.joint_limits.effort]) / np.diag(inertia)
