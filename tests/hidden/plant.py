"""A hidden world that moves: MuJoCo with the forces, delays and losses of mass of what it hides."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from . import bodies
from .mjcf import bus_theta, write
from .numbers import JOINTS, Numbers
from .shortening import Shortening

Array = np.ndarray
Force = Callable[[], None]
STEP = 5e-3  # [s] of RK4 where nothing is stiff or rough


class Plant:
    """One world in MuJoCo. Not for several at a time in one process: passive forces are a global callback."""

    def __init__(self, numbers: Numbers, step: float = STEP) -> None:
        self.numbers = numbers
        self.model = mujoco.MjModel.from_xml_string(write(numbers, step))
        self.model.body_sameframe[:] = 0
        self.data = mujoco.MjData(self.model)
        self._scratch = mujoco.MjData(self.model)
        self.step = step
        d = self.data
        self.qpos, self.qvel, self.passive, self.ctrl = d.qpos, d.qvel, d.qfrc_passive, d.ctrl
        self.ctrl_of = {  # index in ctrl of the motor of a degree of freedom
            int(self.model.jnt_dofadr[self.model.actuator_trnid[k, 0]]): k
            for k in range(self.model.nu)
            if self.model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_JOINT
        }
        self.forces: list[Force] = [Shortening(self)] if numbers.bend else []
        self.hooks: list[Callable[[float], None]] = []  # called before every step with its length [s]

    def q_of(self, joint: str) -> int:
        """Index of a joint in qpos."""
        return int(self.model.jnt_qposadr[self.model.joint(joint).id])

    def v_of(self, joint: str) -> int:
        """Index of a joint in qvel."""
        return int(self.model.jnt_dofadr[self.model.joint(joint).id])

    @property
    def time(self) -> float:
        """Time of the stage that is being evaluated [s]."""
        return float(self.data.time)

    def reset(self) -> None:
        """At rest at t = 0, the arm where it starts."""
        mujoco.mj_resetData(self.model, self.data)
        for joint, angle in zip(JOINTS, self.numbers.start, strict=True):
            self.qpos[self.q_of(joint)] = angle

    def joints(self) -> tuple[Array, Array]:
        """Angles and rates (3,) of the joints' motor side."""
        iq, iv = [self.q_of(j) for j in JOINTS], [self.v_of(j) for j in JOINTS]
        return self.qpos[iq].copy(), self.qvel[iv].copy()

    def torque_for(self, wanted: Array, command: Array) -> Array:
        """Joint torques (3,) that give joint accelerations `wanted` (3,), other commands given."""
        iv = [self.v_of(j) for j in JOINTS]
        trial = np.array(command)
        rows = []
        for unit in (np.zeros(3), *np.eye(3)):
            trial[-3:] = unit
            rows.append(self.acceleration(trial)[iv])
        return np.linalg.solve(np.array(rows[1:]).T - rows[0][:, None], wanted - rows[0])

    def acceleration(self, command: Array) -> Array:
        """MuJoCo's qacc (nv,) at the present state."""
        self.ctrl[:] = command
        with self._callback():
            mujoco.mj_forward(self.model, self.data)
        return self.data.qacc.copy()

    def advance(self, command: Array, duration: float) -> None:
        """Move on by `duration` [s] with a held command (columns,)."""
        self.ctrl[:] = command
        count = max(1, round(duration / self.step + 0.499999)) if duration > 0 else 0
        if not count:
            return
        self.model.opt.timestep = duration / count
        with self._callback():
            if self.hooks:
                for _ in range(count):
                    for hook in self.hooks:
                        hook(duration / count)
                    mujoco.mj_step(self.model, self.data)
            else:
                mujoco.mj_step(self.model, self.data, nstep=count)

    def set_body(self, name: str, change: Array) -> None:
        """Change the inertial parameters of a body by (10,) from what the numbers say, now."""
        theta = bus_theta(self.numbers) if name == "bus" else self.numbers.body[name]
        mass, centre, inertia = bodies.split(theta + change)
        values, axes = np.linalg.eigh(inertia)
        if np.linalg.det(axes) < 0:
            axes[:, 0] = -axes[:, 0]
        b, m = self.model.body(name).id, self.model
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, axes.ravel())
        m.body_mass[b], m.body_ipos[b], m.body_iquat[b], m.body_inertia[b] = mass, centre, quaternion, values
        mujoco.mj_setConst(m, self._scratch)

    def _callback(self) -> _Callback:
        return _Callback(self.forces)


class _Callback:
    """MuJoCo's global callback for passive forces, set while this world moves."""

    def __init__(self, forces: Sequence[Force]) -> None:
        self.forces = tuple(forces)

    def __enter__(self) -> None:
        if self.forces:
            mujoco.set_mjcb_passive(self._call)

    def __exit__(self, *_: object) -> None:
        if self.forces:
            mujoco.set_mjcb_passive(None)

    def _call(self, model: object, data: object) -> None:
        for force in self.forces:
            force()


@dataclass(frozen=True)
class Change:
    """What hiding an effect does to a world. What is not given is left alone.

    numbers: other numbers. force: makes a passive force of a plant (called at every evaluation). hook: makes
    a function of a plant called before each step. command: (t (N,), values (N, columns), names) to what
    arrives. delay: seconds by which the columns named arrive late. mass: (t) to changes (10,) by body.
    ideal: (channel, (t, x, rng) -> x) before noise. read: the same after noise. lever: displacement (3,) of
    a sensor. shift: seconds by which a source's samples are old. step: the largest step [s].
    """

    numbers: Callable[[Numbers], Numbers] | None = None
    force: Callable[[Plant], Force] | None = None
    hook: Callable[[Plant], Callable[[float], None]] | None = None
    command: Callable[[Array, Array, tuple[str, ...]], Array] | None = None
    delay: Mapping[str, float] = field(default_factory=dict)
    mass: Callable[[float], Mapping[str, Array]] | None = None
    ideal: tuple[tuple[str, Callable[..., Array]], ...] = ()
    read: tuple[tuple[str, Callable[..., Array]], ...] = ()
    lever: Mapping[str, Array] = field(default_factory=dict)
    shift: Mapping[str, float] = field(default_factory=dict)
    step: float = STEP

    @property
    def only_sensors(self) -> bool:
        """Whether it leaves the motion alone, and the times it is sampled at."""
        moving = (self.numbers, self.force, self.hook, self.command, self.mass)
        return all(x is None for x in moving) and not self.delay and not self.shift


@dataclass(frozen=True)
class States:
    """A motion at the sampling times, or late by `phase`: MuJoCo's qpos (N, nq), qvel, qacc (N, nv)."""

    time: Array
    qpos: Array
    qvel: Array
    qacc: Array


@dataclass(frozen=True)
class Motion:
    """A simulated world: states by phase (0 and those asked for), and the plant for its indices."""

    plant: Plant
    states: Mapping[float, States]


def simulate(
    numbers: Numbers,
    time: Array,
    values: Array,
    columns: tuple[str, ...],
    changes: Sequence[Change] = (),
    phases: Sequence[float] = (),
    initial: tuple[Array, Array] | None = None,
) -> Motion:
    """Fly a world through held commands `values` (N, columns) at `time` (N,) with hidden changes.

    `phases` [s], within a sampling time: states are also recorded that much after every sample. `initial`:
    displacement and velocity (nv,) at the start, else at rest at home.
    The acceleration at a sample is the limit from the left: sensors are read before the command changes.
    """
    for change in changes:
        if change.numbers:
            numbers = change.numbers(numbers)
    plant = Plant(numbers, min([STEP, *(c.step for c in changes)]))
    plant.forces += [c.force(plant) for c in changes if c.force]
    plant.hooks += [c.hook(plant) for c in changes if c.hook]
    arriving = np.array(values)
    for change in changes:
        if change.command:
            arriving = change.command(time, arriving, columns)
    period = float(time[1] - time[0])
    late, rest = np.zeros(len(columns), dtype=int), np.zeros(len(columns))
    for change in changes:
        for name, seconds in change.delay.items():
            for i in [i for i, c in enumerate(columns) if c == name or c.startswith(f"{name}.")]:
                late[i], rest[i] = divmod(seconds, period)
    losses = [c.mass for c in changes if c.mass]
    wanted = sorted({0.0, *phases})
    cuts = sorted({0.0, *wanted, *(float(r) for r in rest)})
    out: dict[float, list[tuple[Array, Array, Array]]] = {p: [] for p in wanted}
    plant.reset()
    acting = np.zeros(len(columns))
    if initial is not None:
        mujoco.mj_integratePos(plant.model, plant.qpos, initial[0], 1.0)
        plant.qvel[:] = initial[1]
    for k in range(len(time)):
        for loss in losses:
            for body, theta in loss(float(time[k]) + period / 2).items():
                plant.set_body(body, theta)
        for begin, end in zip(cuts, [*cuts[1:], period], strict=True):
            if begin in out:
                acceleration = plant.acceleration(acting)
                out[begin].append((plant.qpos.copy(), plant.qvel.copy(), acceleration))
            index = k - late - (rest > begin)
            acting = np.where(index >= 0, arriving[np.maximum(index, 0), np.arange(len(columns))], 0.0)
            if k + 1 < len(time) or end < period:
                plant.advance(acting, end - begin)
    states = {
        p: States(time + p, *(np.array([row[i] for row in rows]) for i in range(3)))
        for p, rows in out.items()
    }
    return Motion(plant, states)
