"""A satellite from Newton's laws in plain numpy: bus, slosh mass on springs, panel as a sliding mass, wheels.

Nothing of smsid is in it. All bodies move about the origin O of the bus's axes; unknown accelerations are
solved for together.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

import numpy as np

from smsid.description.schema import Description
from smsid.effects import ModalAppendage, Slosh
from smsid.effects.appendage import Mode
from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.sensing.error_model import ErrorModel

URDF = """<robot name="satellite"><link name="bus"><inertial><origin xyz="0 0 0"/><mass value="{mass}"/>
<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
AXES = ("x", "y", "z")


try:
    compiled = import_module("numba").njit(cache=True)
except ImportError:

    def compiled(function):
        """Leave it as it is: slow, and the same."""
        return function


@compiled
def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@compiled
def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def rotation(q):
    x, y, z, w = q[0], q[1], q[2], q[3]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@compiled
def newton(mass, c0, inertia, tank, cs, panel, x, force, torque, wheel_torque):
    """x: p, q (xyzw), v, w body, slosh, slosh rate, panel, panel rate, momenta of wheels in the body."""
    ms, ks, bs = tank[0], tank[1], tank[2]
    f1, z1, lt, lr = panel[0], panel[1], panel[2], panel[3]
    mu, xp, n, w1 = lt**2, np.array([-lr / lt, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), 2 * np.pi * f1
    m_r, first = mass - mu, mass * c0 - mu * xp
    j_r = inertia + mu * skew(xp) @ skew(xp)
    q, v, w = x[3:7], x[7:10], x[10:13]
    d, dd, e, ed, hw = x[13:16], x[16:19], x[19], x[20], x[21:24]
    r, rp = cs + d, xp + n * e
    gs = cross(w, cross(w, r)) + 2 * cross(w, dd)
    gp = cross(w, cross(w, rp)) + 2 * cross(w, n * ed)
    m, b, one = np.zeros((10, 10)), np.zeros(10), np.eye(3)
    m[:3, :3] = (m_r + ms + mu) * one
    m[:3, 3:6] = -skew(first) - ms * skew(r) - mu * skew(rp)
    m[:3, 6:9], m[:3, 9] = ms * one, mu * n
    b[:3] = force - cross(w, cross(w, first)) - ms * gs - mu * gp
    m[3:6, :3] = skew(first) + ms * skew(r) + mu * skew(rp)
    m[3:6, 3:6] = j_r - ms * skew(r) @ skew(r) - mu * skew(rp) @ skew(rp)
    m[3:6, 6:9], m[3:6, 9] = ms * skew(r), mu * cross(rp, n)
    b[3:6] = torque - wheel_torque - cross(w, j_r @ w + hw)
    b[3:6] -= ms * cross(r, gs) + mu * cross(rp, gp)
    m[6:9, :3], m[6:9, 3:6], m[6:9, 6:9] = ms * one, -ms * skew(r), ms * one
    b[6:9] = -ks * d - bs * dd - ms * gs
    m[9, :3], m[9, 3:6], m[9, 9] = mu * n, mu * cross(rp, n), mu
    b[9] = -mu * (2 * z1 * w1 * ed + w1**2 * e) - mu * (gp * n).sum()
    y = np.linalg.solve(m, b)
    qx, qy, qz, qw = q[0], q[1], q[2], q[3]
    rate = np.zeros(24)
    rate[:3] = rotation(q) @ v
    rate[3:7] = 0.5 * np.array(
        [
            qw * w[0] + qy * w[2] - qz * w[1],
            qw * w[1] + qz * w[0] - qx * w[2],
            qw * w[2] + qx * w[1] - qy * w[0],
            -qx * w[0] - qy * w[1] - qz * w[2],
        ]
    )
    rate[7:10], rate[10:13] = y[:3] - cross(w, v), y[3:6]
    rate[13:16], rate[16:19], rate[19], rate[20], rate[21:24] = dd, y[6:9], ed, y[9], wheel_torque
    return rate, y[:3]


@dataclass(frozen=True)
class Satellite:
    """The truth: ``mass``, ``centre``, ``inertia`` about O of all that is rigid, panel at rest included."""

    mass: float = 300.0
    centre: tuple = (0.02, 0.01, -0.05)
    inertia: tuple = ((80.0, 1.0, 0.0), (1.0, 95.0, -2.0), (0.0, -2.0, 70.0))
    tank: tuple = (15.0, 0.5, 0.06)  # mass, stiffness, damping
    tank_at: tuple = (0.0, 0.1, -0.3)
    panel: tuple = (0.22, 0.006, 2.6, -7.5)  # frequency, damping, L_t along z, L_r about y
    wheel: float = 0.04

    def derivative(self, x, force, torque, wheel_torque):
        """Return the rate of a state (24,), as `newton` has it, and the acceleration of O (3,)."""
        own = (self.centre, self.inertia, self.tank, self.tank_at, self.panel)
        given = (np.array(value, dtype=float) for value in (*own, x, force, torque, wheel_torque))
        return newton(float(self.mass), *given)

    def fly(self, seconds, drive, step=0.02, start=None):
        """Return times, states, accelerations of O and inputs; ``drive(t)`` gives force, torque, wheels."""
        x = np.zeros(24)
        x[6] = 1.0
        if start is not None:
            x = np.array(start, dtype=float)
        times = np.arange(round(seconds / step) + 1) * step
        states, accelerations, inputs = [], [], []
        for t in times:
            given = drive(t)
            k1, a = self.derivative(x, *given)
            states.append(np.concatenate([x, k1[10:13]]))
            accelerations.append(a)
            inputs.append(np.concatenate(given))
            k2 = self.derivative(x + step / 2 * k1, *given)[0]
            k3 = self.derivative(x + step / 2 * k2, *given)[0]
            k4 = self.derivative(x + step * k3, *given)[0]
            x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            x[3:7] /= np.linalg.norm(x[3:7])
        return times, np.array(states), np.array(accelerations), np.array(inputs)


NOISE = {"attitude": 5e-5, "angular_rate": 1e-5, "acceleration": 1e-4, "wheel_rate": 0.02}
GYRO_AT = np.array([0.3, 0.2, 0.1])


def recorded(truth, flown, rng, *, every=5, name="flight", without=()):
    """Return the recording of a flight by noisy sensors, every n-th sample; channels may be left out.

    The torque of a wheel's motor is what turns the wheel in space: against the body and with it.
    """
    times, states, accelerations, inputs = (x[::every] for x in flown)
    n = len(times)
    q = states[:, 3:7]
    noise = rng.normal(0.0, 0.5 * NOISE["attitude"], (n, 3))
    turn = np.column_stack([noise, np.ones(n)])
    attitude = quaternion_product(q, turn / np.linalg.norm(turn, axis=1)[:, None])
    w, dw = states[:, 10:13], states[:, 24:27]
    force = accelerations + np.cross(dw, GYRO_AT) + np.cross(w, np.cross(w, GYRO_AT))
    channels = {
        "command.force": inputs[:, :3],
        "command.torque": inputs[:, 3:6],
        "command.wheel_torque": inputs[:, 6:9] + truth.wheel * dw,
        "st.attitude": attitude,
        "gyro.angular_rate": w + rng.normal(0.0, NOISE["angular_rate"], (n, 3)),
        "gyro.acceleration": force + rng.normal(0.0, NOISE["acceleration"], (n, 3)),
        "tacho.wheel_rate": states[:, 21:24] / truth.wheel + rng.normal(0.0, NOISE["wheel_rate"], (n, 3)),
    }
    channels = {k: v for k, v in channels.items() if k not in without}
    return Recording.from_arrays(times, channels, labels={"wheel": ("rw1", "rw2", "rw3")}, name=name)


def quaternion_product(a, b):
    (ax, ay, az, aw), (bx, by, bz, bw) = a.T, b.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def guess(folder, truth, *, off=0.1, tank=True, panel=True):
    """Return a description that is off: the first guess."""
    more = 1.0 + off
    xx, yy, zz = np.diag(truth.inertia) * more
    folder.mkdir(parents=True, exist_ok=True)
    text = URDF.format(mass=truth.mass / more, xx=xx, yy=yy, zz=zz)
    (folder / "satellite.urdf").write_text(text, encoding="utf-8")
    effects = []
    if tank:
        m, k, c = truth.tank
        effects.append(
            Slosh(
                name="tank",
                position=truth.tank_at,
                mass=m / more,
                stiffness=(k / more,) * 3,
                damping=(c / more,) * 3,
            )
        )
    if panel:
        f, z, lt, lr = truth.panel
        mode = Mode(
            frequency=f * more,
            damping=z * more,
            translation=(0.0, 0.0, lt / more),
            rotation=(0.0, lr / more, 0.0),
        )
        effects.append(
            ModalAppendage(
                name="panel",
                position=(0.0, 0.0, 0.0),
                mass=12.0,
                center_of_mass=(2.0, 0.0, 0.0),
                inertia=(0.5, 0.0, 55.0, 0.0, 0.0, 55.0),
                mode=(mode,),
            )
        )
    wheels = [{"name": f"rw{i + 1}", "axis": tuple(np.eye(3)[i]), "inertia": truth.wheel} for i in range(3)]
    sensors = (
        Sensor(name="st", kind="pose", quantities=("attitude",), rate=10.0, errors=_error("attitude")),
        Sensor(
            name="gyro",
            kind="imu",
            position=tuple(GYRO_AT),
            rate=10.0,
            errors=_error("angular_rate", "acceleration"),
        ),
        Sensor(name="tacho", kind="tachometer", rate=10.0, errors=_error("wheel_rate")),
    )
    return Description.model_validate(
        {
            "schema": 1,
            "name": "satellite",
            "urdf": "satellite.urdf",
            "folder": folder,
            "wheel": wheels,
            "effect": effects,
            "sensor": sensors,
            "thrust": {"point": (0.0, 0.0, 0.0)},
        }
    )


def _error(*quantities):
    return {q: ErrorModel(noise_sigma=NOISE[q]) for q in quantities}


def true_values(truth, *, tank=True, panel=True):
    """Return the truth by the names of an estimate."""
    j = np.array(truth.inertia)
    out = {"bus.m": truth.mass}
    out |= {f"bus.m{a}": truth.mass * c for a, c in zip(AXES, truth.centre, strict=True)}
    c = np.array(truth.centre)
    central = j - truth.mass * ((c @ c) * np.eye(3) - np.outer(c, c))
    out |= {f"bus.c{a}": x for a, x in zip(AXES, c, strict=True)}
    for symbol, inertia in (("I", j), ("Ic", central)):
        out |= {f"bus.{symbol}{AXES[i]}{AXES[k]}": inertia[i, k] for i in range(3) for k in range(i, 3)}
    if tank:
        m, k, c = truth.tank
        out |= {"tank.mass": m}
        out |= {f"tank.stiffness.{a}": k for a in AXES} | {f"tank.damping.{a}": c for a in AXES}
    if panel:
        f, z, lt, lr = truth.panel
        out |= {"panel.mode1.frequency": f, "panel.mode1.damping": z}
        out |= {"panel.mode1.translation.z": lt, "panel.mode1.rotation.y": lr}
    out["total.mass"] = truth.mass + (truth.tank[0] if tank else 0.0)
    return out


def burns_and_wheels(t):
    """Thrust along each axis, then all wheels at once."""
    force = np.zeros(3)
    for axis, begin in ((0, 0.0), (1, 24.0), (2, 48.0)):
        if begin <= t < begin + 12.0:
            force[axis] = 2.0 if t < begin + 6.0 else -2.0
    wheel = np.zeros(3)
    if t >= 60.0:
        wheel = 0.08 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * (t - 60.0))
    return force, np.zeros(3), wheel
