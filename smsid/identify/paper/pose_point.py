"""Where the tracked point P is: r_p/b from Exp. 2, by going round Step A and Step B.

The paper treats r_p/b as an unknown to be estimated. The tank c_s and the arms' mounts are known from the bus
origin, the CM of the base, but P is seen only by the sensor that sits there. Assumed off by d, the bus origin
comes out off by -d, and with it all first moments of the bus that Step B finds come out M d too large.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.description.schema import Description
from smsid.errors import DescriptionError, NotIdentifiableError
from smsid.identify.momentum_rows import carried_by_bus
from smsid.identify.paper.hidden_states import Modal, hidden_states
from smsid.identify.paper.momentum import StepA, step_a, step_b
from smsid.identify.paper.momentum_regression import Regression
from smsid.identify.paper.motion import MeasuredMotion
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

TOLERANCE = 1e-5  # [m] by which a round may still move P
ROUNDS = 10


@short_repr
@dataclass(frozen=True)
class PosePoint:
    """The refined point P.

    ``position`` (3,) in the bus frame [m] and its ``sigma`` (3,), that of Step B's first moments over M
    (``chosen``: where they are in its result); ``motion`` has it; ``a`` and ``b`` are the last round's steps;
    ``shifts`` (rounds, 3) what each round moved.
    """

    position: np.ndarray
    sigma: np.ndarray
    motion: MeasuredMotion
    a: StepA
    b: Regression
    chosen: list[int]
    shifts: np.ndarray

    @property
    def rounds(self) -> int:
        """Number of rounds."""
        return len(self.shifts)


def refine_pose_point(
    model: SpacecraftModel,
    motion: MeasuredMotion,
    mass: float,
    *,
    modal: Modal = "smoother",
) -> PosePoint:
    """Move P (and the IMU, which sits there) until Step B's first moments of the bus are the described ones.

    ``model`` carries what Exp. 1 found for slosh and appendages, ``mass`` is M [kg]. What stays known is the
    description's: bus origin at the base's CM (or wherever its URDF puts the CM), appendages, and the links'
    masses, of which only combinations with the bus's first moments can be identified: links a kilogram off
    move P by their mount over M, 0.5 mm/kg for the paper's arm. Stops when a round moves P by less than
    `TOLERANCE`.

    Raises `NotIdentifiableError` when the bus's first moments are not identifiable, or it does not converge.
    """
    shifts: list[np.ndarray] = []
    noise = hidden_states(model, motion, modal).again  # the same in every round
    for _ in range(ROUNDS):
        hidden = replace(hidden_states(model, replace(motion, again=None), modal), again=noise)
        a = step_a(model, motion, hidden, mass)
        b = step_b(model, motion, hidden, mass, a.position)
        chosen, described = _described_moments(model, b)
        shift = (described - b.values[chosen]) / mass
        shifts.append(shift)
        motion = _shift_points(motion, shift)
        if np.linalg.norm(shift) < TOLERANCE:
            sigma = b.sigma[chosen] / mass
            return PosePoint(motion.pose_point, sigma, motion, a, b, chosen, np.array(shifts))
    raise NotIdentifiableError(
        f"The tracked point does not settle: the last of {ROUNDS} rounds moved it by "
        f"{np.linalg.norm(shifts[-1]):.2g} m.",
        advice="Check the description's mounts, or fly a richer Exp. 2.",
        shifts=np.array(shifts),
    )


def with_tracked_point(description: Description, position: tuple[float, float, float]) -> Description:
    """Return the description with its pose sensors, and IMUs that sit where they do, at ``position`` [m].

    ``position`` (3,) of the tracked point P in the bus frame: r_p/b of the paper. Raises `DescriptionError`
    without a pose sensor.
    """
    pose = [s for s in description.sensor if s.kind == "pose"]
    if not pose:
        raise DescriptionError(
            f"'{description.name}' has no pose sensor, so no point is tracked.",
            advice="Describe a sensor of kind 'pose'.",
        )
    places = {s.position for s in pose}
    return description.with_sensors(
        *(
            s.model_copy(update={"position": position})
            if s.kind == "pose" or (s.kind == "imu" and s.position in places)
            else s
            for s in description.sensor
        )
    )


def _shift_points(motion: MeasuredMotion, shift: np.ndarray) -> MeasuredMotion:
    return replace(
        motion,
        pose_point=motion.pose_point + shift,
        imu_point=motion.imu_point + shift,
        again=_shift_points(motion.again, shift) if motion.again else None,
    )


def _described_moments(model: SpacecraftModel, b: Regression) -> tuple[list[int], np.ndarray]:
    """Where the bus's three first moments are in Step B's result, and their described values [kg m]."""
    regressor = Regressor(model)
    bus = regressor.bodies[0]
    leading = [b.theta_names[i] for i in b.base.independent]
    wanted = [f"{bus}.m{axis}" for axis in "xyz"]
    missing = [name for name in wanted if name not in leading]
    if missing:
        raise NotIdentifiableError(
            f"{', '.join(missing)} cannot be identified, so neither can the tracked point.",
            advice="Turn the bus about more than one axis.",
            missing=missing,
        )
    theta = regressor.parameters + carried_by_bus(model, regressor)
    values = b.base.values(theta[[regressor.names.index(n) for n in b.theta_names]])
    chosen = [leading.index(name) for name in wanted]
    return chosen, values[chosen]
