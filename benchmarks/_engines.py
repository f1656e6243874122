"""The engines of the speed benchmark. Each runs a case: seconds taken, and states at 1, 2, ... 80 s.

The setting is an integer, larger is finer: steps a second of a fixed-step method, tolerance 10^(-setting / 8)
of an adaptive one. Setting up (models, torque tables) is not timed.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np
import pinocchio as pin
from _exp2 import DURATION, FREQUENCY, JOINT_COS, JOINT_SIN, RATE, WHEEL_COS, WHEEL_SIN
from _mjcf import Twin, mujoco_twin, write_mjcf
from mujoco import rollout

from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate import Inputs, Tolerance, simulate, simulate_closed_loop

DIVISORS = [n for n in range(20, 1001) if 10**9 % n == 0]  # Basilisk counts time in nanoseconds
SECONDS = np.arange(1.0, DURATION + 1.0)


@dataclass(frozen=True)
class Case:
    """A motion to compute: from home with velocities v0 (nv,), under inputs."""

    model: SpacecraftModel
    inputs: Inputs
    v0: np.ndarray
    steps_multiple: int = 1  # fixed steps a second must be a multiple of this

    def twin(self) -> Twin:
        """Return the spacecraft in MuJoCo, springs and dampers included."""
        return mujoco_twin(self.model.pin, *self.springs())

    def springs(self) -> tuple[np.ndarray, np.ndarray]:
        """Return stiffness and damping, (nv,) each."""
        stiffness, damping = np.zeros(self.model.nv), np.zeros(self.model.nv)
        stiffness[self.model.spring_v] = self.model.stiffness
        damping[self.model.spring_v] = self.model.damping
        return stiffness, damping


class Engine(Protocol):
    """Computes a case with one of its settings, ordered from coarse to fine."""

    settings: Sequence[int]
    fixed_step: bool

    def run(self, setting: int) -> tuple[float, np.ndarray]:
        """Return seconds taken and states (seconds, nq + nv) in Pinocchio's order."""
        ...


class Smsid:
    """`smsid.simulate.simulate`; with ``rate`` [Hz], states and accelerations at that rate are timed too."""

    settings, fixed_step = range(4 * 8, 13 * 8), False

    def __init__(self, case: Case, rate: float | None = None) -> None:
        self.case, self.rate = case, rate

    def run(self, setting: int) -> tuple[float, np.ndarray]:
        tolerance = Tolerance(10 ** (-setting / 8), 10 ** (-setting / 8 - 2))
        begin = time.perf_counter()
        motion = simulate(self.case.model, self.case.inputs, DURATION, v0=self.case.v0, tolerance=tolerance)
        if self.rate is not None:
            motion.states(np.arange(round(DURATION * self.rate) + 1) / self.rate)
        taken = time.perf_counter() - begin
        states = motion.states(SECONDS)
        return taken, np.hstack([states.q, states.v])


class SmsidFixedStep:
    """`smsid.simulate.simulate_closed_loop` with a controller that looks the held torque up."""

    settings, fixed_step = range(20, 601), True

    def __init__(self, case: Case) -> None:
        self.case = case

    def run(self, setting: int) -> tuple[float, np.ndarray]:
        applied = self.case.inputs.applied(self.case.model)
        table = [applied((k + 0.5) / RATE) for k in range(round(DURATION * RATE))]
        begin = time.perf_counter()
        motion = simulate_closed_loop(
            self.case.model,
            lambda t, q, v: table[round(t * RATE)],
            DURATION,
            dt=1.0 / setting,
            control_rate=RATE,
            v0=self.case.v0,
            audit=False,
        )
        taken = time.perf_counter() - begin
        return taken, np.hstack([motion.q, motion.v])[setting::setting]


class MujocoRollout:
    """`mujoco.rollout` with RK4, one thread. ``torque``: none, held (per step, sampled in it), callback.

    With ``callback`` a C function compiled here gives the Fourier torque at every stage.
    """

    settings, fixed_step = range(20, 4001), True

    def __init__(self, case: Case, torque: str) -> None:
        self.case, self.torque = case, torque
        self.twin = case.twin()
        self.callback = _fourier_in_c(self.twin, case.model) if torque == "callback" else None

    def run(self, setting: int) -> tuple[float, np.ndarray]:
        model, data = self.twin.model, self.twin.data
        steps = round(DURATION * setting)
        model.opt.timestep = 1.0 / setting
        mujoco.mj_resetData(model, data)
        data.qpos[:] = self.twin.position(self.case.model.home)
        data.qvel[:] = self.twin.velocity(self.case.model.home, self.case.v0)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty((1, mujoco.mj_stateSize(model, kind)))
        mujoco.mj_getState(model, data, start[0], kind)
        keys = {"nstep": steps}
        if self.torque == "held":
            times = (np.arange(steps) + 0.5) / setting
            applied = self.case.inputs.applied(self.case.model)
            control = np.zeros((1, steps, model.nv))
            control[0][:, self.twin.dof] = [applied(float(t)) for t in times]
            keys = {"control": control, "control_spec": mujoco.mjtState.mjSTATE_QFRC_APPLIED}
        mujoco.set_mjcb_control(self.callback)
        try:
            begin = time.perf_counter()
            states, _ = rollout.rollout(model, data, start, **keys)
            taken = time.perf_counter() - begin
        finally:
            mujoco.set_mjcb_control(None)
        rows = states[0][setting - 1 :: setting]
        nq, nv = model.nq, model.nv
        return taken, np.array([self.twin.state(r[1 : 1 + nq], r[1 + nq : 1 + nq + nv]) for r in rows])


class Basilisk:
    """Basilisk's MJScene (MuJoCo's dynamics, Basilisk's integrators in C++), free motion only."""

    def __init__(self, case: Case, integrator: str) -> None:
        self.case, self.integrator = case, integrator
        self.fixed_step = integrator == "svIntegratorRK4"
        self.settings = DIVISORS if self.fixed_step else range(4 * 8, 15 * 8)
        self.xml = write_mjcf(case.model.pin, *case.springs())
        self.twin = case.twin()

    def run(self, setting: int) -> tuple[float, np.ndarray]:
        from Basilisk.simulation import mujoco as scenes
        from Basilisk.simulation import svIntegrators
        from Basilisk.utilities import SimulationBaseClass, macros

        step = 10**9 // setting if self.fixed_step else macros.sec2nano(1.0)  # [ns]
        simulation = SimulationBaseClass.SimBaseClass()
        simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", step))
        scene = scenes.MJScene(self.xml)
        simulation.AddModelToTask("task", scene)
        integrator = getattr(svIntegrators, self.integrator)(scene)
        if not self.fixed_step:
            integrator.setRelativeTolerance(10 ** (-setting / 8))
            integrator.setAbsoluteTolerance(10 ** (-setting / 8 - 2))
        scene.setIntegrator(integrator)
        simulation.InitializeSimulation()
        self._start(scene)
        read = []
        begin = time.perf_counter()
        for second in SECONDS:
            simulation.ConfigureStopTime(macros.sec2nano(float(second)))
            simulation.ExecuteSimulation()
            message = scene.stateOutMsg.read()
            read.append((np.array(message.qpos).ravel(), np.array(message.qvel).ravel()))
        taken = time.perf_counter() - begin
        return taken, np.array([self.twin.state(qpos, qvel) for qpos, qvel in read])

    def _start(self, scene) -> None:
        model, home, v0 = self.case.model.pin, self.case.model.home, self.case.v0
        bus = scene.getBody("b1")
        bus.setPosition(home[:3].tolist())
        bus.setVelocity(v0[:3].tolist())  # home is not turned: body axes are inertial axes
        bus.setAttitudeRate(v0[3:6].tolist())
        for j in range(2, model.njoints):
            for i in range(model.joints[j].nv):
                joint = scene.getBody(f"b{j}").getScalarJoint(f"{j}.{i}")
                joint.setPosition(float(home[model.joints[j].idx_q + i]))
                joint.setVelocity(float(v0[model.joints[j].idx_v + i]))


class PinocchioRk4:
    """A plain loop in Python: classical RK4 on (p, quaternion, joints, v) over `pin.aba`."""

    settings, fixed_step = range(20, 1001), True

    def __init__(self, case: Case) -> None:
        self.case = case
        self.applied = case.inputs.applied(case.model)
        m = case.model
        self.springs = m.spring_q, m.spring_v, m.stiffness, m.damping

    def run(self, setting: int) -> tuple[float, np.ndarray]:
        model, h = self.case.model.pin, 1.0 / setting
        hold = setting // round(RATE) if self.case.steps_multiple > 1 else 0  # steps a held torque lasts
        nq, rows = model.nq, []
        y = np.concatenate([self.case.model.home, self.case.v0])
        begin = time.perf_counter()
        for n in range(round(DURATION * setting)):
            t = (n // hold) / RATE if hold else n * h
            middle, end = (t, t) if hold else (t + h / 2, t + h)
            k1 = self._rate(model, t, y)
            k2 = self._rate(model, middle, y + h / 2 * k1)
            k3 = self._rate(model, middle, y + h / 2 * k2)
            k4 = self._rate(model, end, y + h * k3)
            y = y + h / 6 * (k1 + 2 * (k2 + k3) + k4)
            y[3:7] /= np.linalg.norm(y[3:7])
            if (n + 1) % setting == 0:
                rows.append(y)
        taken = time.perf_counter() - begin
        return taken, np.array(rows)[:, : nq + model.nv]

    def _rate(self, model: pin.Model, t: float, y: np.ndarray) -> np.ndarray:
        q, v = y[: model.nq], y[model.nq :]
        spring_q, spring_v, stiffness, damping = self.springs
        tau = np.array(self.applied(t))
        tau[spring_v] -= stiffness * q[spring_q] + damping * v[spring_v]
        x, yy, z, w = q[3:7]
        a, b, c = 0.5 * v[3:6]
        out = np.empty_like(y)
        out[:3] = pin.Quaternion(w, x, yy, z).toRotationMatrix() @ v[:3]
        out[3:7] = (
            w * a + yy * c - z * b,
            w * b + z * a - x * c,
            w * c + x * b - yy * a,
            -x * a - yy * b - z * c,
        )
        out[7 : model.nq] = v[6:]
        out[model.nq :] = pin.aba(model, self.case.model.data, q, v, tau)
        return out


def _fourier_in_c(twin: Twin, model: SpacecraftModel) -> object:
    """Compile the Fourier torques as MuJoCo's control callback; needs a C compiler."""
    dof = [int(twin.dof[i]) for i in [*model.wheels.v, *model.arm_joints.v]]
    tables = [WHEEL_COS + JOINT_COS, WHEEL_SIN + JOINT_SIN]
    cos, sin = ("{" + ",".join("{" + ",".join(map(repr, row)) + "}" for row in t) + "}" for t in tables)
    source = f"""#include <math.h>
#include <mujoco/mujoco.h>
static const double C[6][5] = {cos}, S[6][5] = {sin};
static const int dof[6] = {{{",".join(map(str, dof))}}};
void control(const mjModel* m, mjData* d) {{
  double c[5], s[5], w = 2 * 3.14159265358979323846 * {FREQUENCY!r} * d->time;
  for (int l = 0; l < 5; l++) {{ c[l] = cos((l + 1) * w); s[l] = sin((l + 1) * w); }}
  for (int i = 0; i < 6; i++) {{
    double x = 0;
    for (int l = 0; l < 5; l++) x += C[i][l] * c[l] + S[i][l] * s[l];
    d->qfrc_applied[dof[i]] = x;
  }}
}}
"""
    headers = Path(mujoco.HEADERS_DIR).parent
    with tempfile.TemporaryDirectory() as folder:
        code, library = Path(folder) / "torque.c", Path(folder) / "torque.so"
        code.write_text(source, encoding="utf-8")
        line = ["cc", "-O2", "-shared", "-fPIC", f"-I{headers}", "-o", str(library), str(code), "-lm"]
        subprocess.run(line, check=True)
        return ctypes.CDLL(str(library)).control
