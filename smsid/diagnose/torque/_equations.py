"""Torque equations of a welded arm: measured joint torques against rows linear in what is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from smsid.arm.identify import rigid_arm, structural_base, torque_rows
from smsid.arm.level import gravity_slopes, with_gravity
from smsid.arm.motion import ArmMotion, even_readings, joint_motion, measured_states
from smsid.arm.near_rest import near_rest
from smsid.description import Description
from smsid.effects.external import tilt_of
from smsid.errors import RecordingError
from smsid.identify.robust import white_sigma
from smsid.model.identifiable import BaseParameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing.filters import zero_phase

HIGHEST = 100.0
"""Motion above this frequency is that of structures, which no rigid arm has [Hz]."""

BAND = 25.0
"""Torques are compared up to this frequency [Hz], or a `SHARE` of the motion's low-pass if that is less."""

SHARE = 0.4
NOISY = 0.01
"""Share of a joint's acceleration that the noise of its angle may make up."""

STEP = 1e-5
"""Of the finite difference by an angle [rad]."""

SAMPLES_PER_PERIOD = 1.6
"""Instants kept per period of the band. No more: what the low-pass has taken away would have to be whitened.
What folds over does so on both sides of the equations."""

SETTLING = 2.0
"""Periods of the band left out at either end, where the filter does not know what lies beyond."""


@dataclass(frozen=True)
class TorqueEquations:
    """``torque = rows @ beta`` at n instants, both sides through one low-pass.

    ``motion`` is the finer one of N instants that columns are made from; `filtered` brings what was made
    from it to the n instants ``time`` (n,) [s]. Filtering columns like the torques keeps a jump, such as
    Coulomb friction's at a reversal, alike on both sides (Gautier's parallel decimation).
    ``fine`` (N, joints, b) are the rows before that, ``rows`` (n, joints, b) after, ``torque`` (n, joints)
    [N m], ``base`` the identifiable combinations, ``band`` [Hz], ``noise`` (joints,) the level [N m] of the
    torque's white noise within the band, ``interval`` between samples of the recording, ``late`` by how
    much the angles were taken to be late [s]. Of several recordings all stand one after the other, and
    ``parts`` are the equations of each: filters do not reach from one into the next.
    """

    description: Description
    model: SpacecraftModel
    base: BaseParameters
    motion: ArmMotion
    fine: np.ndarray
    rows: np.ndarray
    torque: np.ndarray
    time: np.ndarray
    band: float
    noise: np.ndarray
    interval: float
    late: float = 0.0
    turns: dict[int, np.ndarray] = field(default_factory=dict, compare=False, repr=False)
    parts: tuple[TorqueEquations, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Joints in the order of the columns of ``torque``."""
        order = np.argsort(self.model.arm_joints.v)
        return tuple(self.model.arm_joints.names[i] for i in order.tolist())

    @property
    def angles(self) -> np.ndarray:
        """Joint angles (N, joints) on the motion's instants, in the order of the torques [rad]."""
        order = np.argsort(self.model.arm_joints.v)
        return self.model.joint_angles(self.motion.q)[:, order]

    def slope(self, joint: int) -> np.ndarray:
        """Return the derivative of the fine rows by the angle of one joint (N, joints, b)."""
        if joint not in self.turns:
            out = np.zeros_like(self.fine)
            for way in (STEP, -STEP):
                angles = self.model.joint_angles(self.motion.q)
                angles[:, int(np.argsort(self.model.arm_joints.v)[joint])] += way
                q = np.array([self.model.set_joint_angles(self.model.home, x) for x in angles])
                rows, _, _ = torque_rows(self.model, replace(measured_states(self.motion), q=q))
                out += rows[:, :, self.base.independent] / (2.0 * way)
            self.turns[joint] = out
        return self.turns[joint]

    @property
    def tilt(self) -> np.ndarray:
        """The angles (2,) by which described gravity leans in these equations [rad]."""
        tilt = tilt_of(self.description.effect)
        return np.zeros(2) if tilt is None else np.array([tilt.x, tilt.y])

    @cached_property
    def lean(self) -> np.ndarray:
        """The derivative of the links' fine rows by these angles (N, joints, links, 2)."""
        q, still = self.motion.q, np.zeros_like(self.motion.v)
        slopes = gravity_slopes(np.asarray(self.description.gravity), self.tilt)
        rows = [Regressor(with_gravity(self.model, g)).torque(q, still, still) for g in slopes.T]
        return np.stack(rows, axis=-1)

    @cached_property
    def near_rest(self) -> np.ndarray:
        """Whether a joint is so slow or turns round, within the reach of the low-pass, that no law says what
        its friction is (n, joints).
        """
        if self.parts:
            return np.concatenate([p.near_rest for p in self.parts])
        return near_rest(self.motion.time, self.motion.v, self.time, 1.0 / self.band)

    def filtered(self, values: np.ndarray) -> np.ndarray:
        """Return values (N, ...) on the motion's instants low-passed to the instants of the equations."""
        if self.parts:
            ends = np.cumsum([len(p.motion.time) for p in self.parts])[:-1]
            own = zip(self.parts, np.split(values, ends), strict=True)
            return np.concatenate([p.filtered(x) for p, x in own])
        return _low_pass(values, self.motion.rate, self.band)


def torque_equations(
    description: Description,
    recording: Recording | Sequence[Recording],
    *,
    cutoff: float | None = None,
    band: float | None = None,
    late: float = 0.0,
) -> TorqueEquations:
    """Return the equations of a recording, all inertial combinations and listed effects in the rows.

    Args:
        description: a welded arm.
        recording: joint angles and torques, see `joint_motion`; or several, stacked.
        cutoff: low-pass of the motion [Hz]; default `motion_cutoff`.
        band: highest frequency at which torques are compared [Hz].
        late: by how much the angles are late against the torques [s].

    Raises:
        DescriptionError: not a welded arm, or an effect that does not enter torques linearly.
        RecordingError: as `joint_motion`, or the record is shorter than its filters.
    """
    model = rigid_arm(description)
    if not isinstance(recording, Recording):
        if cutoff is None:
            cutoff = min(motion_cutoff(model, r) for r in recording)
        parts = [torque_equations(description, r, cutoff=cutoff, band=band, late=late) for r in recording]
        return parts[0] if len(parts) == 1 else _stack_recordings(parts)
    top = motion_cutoff(model, recording) if cutoff is None else float(cutoff)
    motion = joint_motion(model, recording, top, late=late)
    within = min(SHARE * top, BAND) if band is None else float(band)
    base = structural_base(model)
    every, _, _ = torque_rows(model, measured_states(motion))
    fine = every[:, :, base.independent]
    readings, rate = even_readings(model, recording)
    noise = white_sigma(readings.torque) * np.sqrt(2.0 * within / rate)
    return TorqueEquations(
        description, model, base, motion, fine,
        _low_pass(fine, motion.rate, within),
        _low_pass(motion.torque, motion.rate, within),
        _banded_times(motion.time, motion.rate, within),
        within, noise, 1.0 / rate, late,
    )  # fmt: skip


def _stack_recordings(parts: Sequence[TorqueEquations]) -> TorqueEquations:
    """Return equations of several recordings as one: each begins a sample after the one before."""

    def whole(name: str) -> np.ndarray:
        return np.concatenate([getattr(p.motion, name) for p in parts])

    joined = replace(
        parts[0].motion, time=_join_clocks([p.motion.time for p in parts]),
        q=whole("q"), v=whole("v"), a=whole("a"), torque=whole("torque"),
    )  # fmt: skip
    fine, rows, torque = (np.concatenate([getattr(p, k) for p in parts]) for k in ("fine", "rows", "torque"))
    counts = np.array([len(p.torque) for p in parts])
    noise = np.sqrt(np.average([p.noise**2 for p in parts], axis=0, weights=counts))
    return replace(
        parts[0], motion=joined, fine=fine, rows=rows, torque=torque, noise=noise,
        time=_join_clocks([p.time for p in parts]), interval=max(p.interval for p in parts), turns={},
        parts=tuple(parts),
    )  # fmt: skip


def _join_clocks(clocks: Sequence[np.ndarray]) -> np.ndarray:
    """Return clocks as one."""
    out = [clocks[0]]
    for clock in clocks[1:]:
        out.append(clock + (out[-1][-1] + float(np.median(np.diff(clock))) - clock[0]))
    return np.concatenate(out)


def require_excitation(equations: TorqueEquations, named: str) -> None:
    """Raise `RecordingError` for recordings without motion, or without torque."""
    moved = np.ptp(equations.angles, axis=0) if len(equations.angles) else np.zeros(0)
    still = [n for n, size in zip(equations.names, moved, strict=True) if not size > 0.0]
    if len(still) == len(equations.names):
        raise RecordingError(
            f"No joint of '{named}' moves: {', '.join(still)}.",
            advice="Record a motion.",
            still=still,
        )
    idle = [
        n
        for n, k in zip(equations.names, range(len(equations.names)), strict=True)
        if not np.ptp(equations.motion.torque[:, k]) > 0.0
    ]
    if len(idle) == len(equations.names):
        raise RecordingError(
            f"The torques of '{named}' are constant: {', '.join(idle)}.",
            advice="Is the right channel mapped?",
            idle=idle,
        )


def motion_cutoff(model: SpacecraftModel, recording: Recording) -> float:
    """Return the highest low-pass at which noise of the angles stays out of the accelerations [Hz].

    At most a tenth of the sampling rate and `HIGHEST`; below that, where noise would make up more than
    `NOISY` of any moving joint's acceleration: what is wrong in the columns biases what is fitted with them.

    Raises:
        RecordingError: as `joint_motion`.
    """
    readings, rate = even_readings(model, recording)
    top = min(rate / 10.0, HIGHEST)
    sigma = white_sigma(readings.position)
    for share in 0.8 ** np.arange(12):
        cutoff = float(share * top)
        smooth = zero_phase(readings.position, rate, cutoff)
        step = max(1, int(rate / (10.0 * cutoff)))
        slow = smooth[::step]
        size = np.std(np.diff(slow, n=2, axis=0), axis=0) * (rate / step) ** 2
        # of white noise with one-sided density 2 sigma^2 / rate, twice differentiated, up to the cutoff
        noise = sigma * np.sqrt(2.0 * cutoff / rate / 5.0) * (2.0 * np.pi * cutoff) ** 2
        moving = size > 0.0
        if np.all(noise[moving] <= NOISY * size[moving]):
            return cutoff
    return float(0.8**11 * top)


def _low_pass(values: np.ndarray, rate: float, band: float) -> np.ndarray:
    kept = _kept_samples(len(values), rate, band)
    if values.size == 0:
        return values[kept]
    flat = zero_phase(values.reshape(len(values), -1), rate, band)[kept]
    return flat.reshape(len(flat), *values.shape[1:])


def _banded_times(times: np.ndarray, rate: float, band: float) -> np.ndarray:
    return times[_kept_samples(len(times), rate, band)]


def _kept_samples(samples: int, rate: float, band: float) -> slice:
    edge = round(SETTLING * rate / band)
    if 2 * edge >= samples:
        raise RecordingError(
            f"{samples / rate:.3g} s of motion are all edge for a low-pass at {band:g} Hz.",
            advice="Record longer.",
        )
    return slice(edge, samples - edge, max(1, int(rate / (SAMPLES_PER_PERIOD * band))))
