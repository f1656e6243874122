"""T, V and dissipation of every part, written in sympy from velocities of material points.

Vectors are in body axes; each part's velocity is that of equations (1)-(5). From its kinetic energy T_i a
part contributes, with u = [v_b, omega_b, s_dot] (18) and s = [wheels, q_r, rho_s, delta] (12),

    momenta          P = dT_i/du                                               (18,)
    mass matrix      M = dP/du                                                 (18, 18)
    bias             c = (dP/ds) s_dot + [omega x P_v; omega x P_omega + v x P_v; -dT_i/ds]
                       + [0; 0; dV_i/ds + dF_i/ds_dot]                         (18,)

which are (10), (11), (14), (15) as printed and (12), (13) as the errata have them: rho and delta are
coordinates with components in body axes, so their equations are d/dt dT/ds_dot - dT/ds = -dV/ds - dF/ds_dot.
For the slosh this is (12) with the printed term: -dT/d rho = omega x dT/d rho_dot.
"""

from __future__ import annotations

import cmath
import hashlib
import inspect
import math
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import sympy as sp

V = sp.Matrix(sp.symbols("v1:4"))
W = sp.Matrix(sp.symbols("w1:4"))
WHEEL_RATE = sp.Matrix(sp.symbols("wheel1:4_dot"))
Q, QD = sp.Matrix(sp.symbols("q1:4")), sp.Matrix(sp.symbols("q1:4_dot"))
RHO, RHO_DOT = sp.Matrix(sp.symbols("rho1:4")), sp.Matrix(sp.symbols("rho1:4_dot"))
DELTA, DELTA_DOT = sp.Matrix(sp.symbols("delta1:4")), sp.Matrix(sp.symbols("delta1:4_dot"))

U = [*V, *W, *WHEEL_RATE, *QD, *RHO_DOT, *DELTA_DOT]  # (18) velocities
S = [*sp.symbols("wheel1:4"), *Q, *RHO, *DELTA]  # (12) coordinates, their rates are U[6:]

Energies = tuple[sp.Expr, sp.Expr, sp.Expr, list[sp.Symbol]]  # T, V, dissipation function, parameters


def _cos(x: complex) -> complex:
    return cmath.cos(x) if isinstance(x, complex) else math.cos(x)


def _sin(x: complex) -> complex:
    return cmath.sin(x) if isinstance(x, complex) else math.sin(x)


def _vector(name: str) -> sp.Matrix:
    return sp.Matrix(sp.symbols(f"{name}_x {name}_y {name}_z"))


def _symmetric(name: str) -> tuple[sp.Matrix, list[sp.Symbol]]:
    """Symmetric 3 x 3 matrix and its symbols in the order xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = six = sp.symbols([f"{name}_{k}" for k in ("xx", "yy", "zz", "xy", "xz", "yz")])
    return sp.Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), list(six)


def _total_derivative(r: sp.Matrix) -> sp.Matrix:
    """Component-wise time derivative of r(s)."""
    return r.jacobian(S) * sp.Matrix(U[6:])


def _point_velocity(r: sp.Matrix) -> sp.Matrix:
    """Inertial velocity of the point r(s) of the body frame, body axes: (2)."""
    return V + W.cross(r) + _total_derivative(r)


def _half(m: sp.Expr, v: sp.Matrix) -> sp.Expr:
    return m * v.dot(v) / 2


def base() -> Energies:
    """The base without the wheels' spin inertia; its centre of mass is the body origin."""
    mass = sp.Symbol("m_b")
    inertia, six = _symmetric("I_b")
    return _half(mass, V) + (W.T * inertia * W)[0] / 2, sp.S(0), sp.S(0), [mass, *six]


def wheels() -> Energies:
    """Three axisymmetric rotors about x, y, z: only the spin energy, the rest is the base's."""
    spin = _vector("I_rw")
    kinetic = sum(spin[k] * (W[k] + WHEEL_RATE[k]) ** 2 for k in range(3)) / 2
    return kinetic, sp.S(0), sp.S(0), list(spin)


def _axis_rotation(axis: str, angle: sp.Symbol) -> sp.Matrix:
    c, s = sp.cos(angle), sp.sin(angle)
    return {
        "x": sp.Matrix([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": sp.Matrix([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": sp.Matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def link(index: int, axes: tuple[str, ...]) -> Energies:
    """Link `index` (0-based) of the arm: position (3), velocity (4), rate as the sum of joint rates."""
    mount, mass, centre = _vector("mount"), sp.Symbol("m"), _vector("centre")
    turn = sp.Matrix(3, 3, sp.symbols("R_mount1:10"))
    inertia, six = _symmetric("I")
    position, rate, parameters = mount, W, [*mount, *turn]
    for k in range(index + 1):
        turn = turn * _axis_rotation(axes[k], Q[k])
        unit = sp.Matrix(
            [int(axes[k] == name) for name in "xyz"]
        )  # the joint axis is the same in both frames
        rate = rate + turn * unit * QD[k]
        if k < index:
            tip = _vector(f"tip{k}")
            position = position + turn * tip
            parameters += [*tip]
    velocity = _point_velocity(position + turn * centre)
    local = turn.T * rate  # link axes
    kinetic = _half(mass, velocity) + (local.T * inertia * local)[0] / 2
    return kinetic, sp.S(0), sp.S(0), [*parameters, mass, *centre, *six]


def slosh() -> Energies:
    """A particle on three springs and dampers along the body axes: (1), (2)."""
    mass, stiffness, damping, centre = sp.Symbol("m_s"), _vector("k_s"), _vector("b_s"), _vector("c_s")
    potential = sum(stiffness[k] * RHO[k] ** 2 for k in range(3)) / 2
    dissipation = sum(damping[k] * RHO_DOT[k] ** 2 for k in range(3)) / 2
    return (
        _half(mass, _point_velocity(centre + RHO)),
        potential,
        dissipation,
        [mass, *stiffness, *damping, *centre],
    )


def panel(variant: str) -> Energies:
    """The plate in three assumed modes about the clamp C, bending along z.

    `exact`         T integrated over the material points C + (x, y, z + sum phi_k delta_k);
    `first_order`   the same without the terms of second order in delta;
    `frozen`        (7) and (9) as printed: I_a,b does not depend on delta;
    `point_masses`  a particle L_t^2 a mode at C + (L_r/L_t, 0, delta/L_t), and the plate's rigid remainder.
    """
    root, omega, zeta = _vector("r_c"), _vector("omega_a"), sp.Symbol("zeta")
    trans, rot = _vector("L_t"), _vector("L_r")
    mass, first, xx, yy, zz = sp.symbols("m_a S_x S_xx S_yy S_zz")  # integrals of 1, x, x^2, y^2, z^2
    x, y, z, *phi = sp.symbols("x y z phi1:4")

    def integrate(integrand: sp.Expr) -> sp.Expr:
        """Integrate a polynomial over the plate: modes are orthonormal, y and z are centred."""
        table = {(0, 0, 0): mass, (1, 0, 0): first, (2, 0, 0): xx, (0, 2, 0): yy, (0, 0, 2): zz}
        total = sp.S(0)
        for (a, b, c, *modes), coefficient in sp.Poly(sp.expand(integrand), x, y, z, *phi).terms():
            used = [k for k in range(3) for _ in range(modes[k])]
            if b % 2 == 1 or c % 2 == 1 or (len(used) == 2 and used[0] != used[1]):
                continue
            if not used:
                value = table[a, b, c]
            elif len(used) == 1:
                value = (trans, rot)[a][used[0]]
            else:
                value = sp.S(1)
            total += coefficient * value
        return total

    flat = root + sp.Matrix([x, y, z])
    bent = root + sp.Matrix([x, y, z + sum(phi[k] * DELTA[k] for k in range(3))])
    if variant in ("exact", "first_order"):
        kinetic = integrate(_half(sp.S(1), _point_velocity(bent)))
        if variant == "first_order":
            eps = sp.Symbol("eps")
            series = sp.expand(kinetic.subs({d: eps * d for d in DELTA}, simultaneous=True))
            kinetic = series.coeff(eps, 0) + series.coeff(eps, 1)
    elif variant == "frozen":
        inertia = W.dot(flat.cross(W.cross(flat)))  # omega . I omega per unit mass
        moment = sp.Matrix([mass * root[0] + first, mass * root[1], mass * root[2] + trans.dot(DELTA)])
        linear = sp.Matrix([0, 0, trans.dot(DELTA_DOT)])
        angular = sp.Matrix([0, -rot.dot(DELTA_DOT), 0]) + root.cross(linear)
        kinetic = _half(mass, V) + V.dot(W.cross(moment)) + integrate(inertia) / 2 + V.dot(linear)
        kinetic += W.dot(angular) + DELTA_DOT.dot(DELTA_DOT) / 2
    elif variant == "point_masses":
        kinetic = integrate(_half(sp.S(1), V + W.cross(flat)))
        for k in range(3):
            at = root + sp.Matrix([rot[k] / trans[k], 0, 0])
            moved = at + sp.Matrix([0, 0, DELTA[k] / trans[k]])
            kinetic += _half(trans[k] ** 2, _point_velocity(moved)) - _half(trans[k] ** 2, V + W.cross(at))
    else:
        raise ValueError(f"unknown panel variant {variant!r}")
    potential = sum((omega[k] * DELTA[k]) ** 2 for k in range(3)) / 2
    dissipation = sum(zeta * omega[k] * DELTA_DOT[k] ** 2 for k in range(3))
    parameters = [*root, mass, first, xx, yy, zz, *trans, *rot, *omega, zeta]
    return kinetic, potential, dissipation, parameters


@cache
def compile_part(part: str, axes: tuple[str, ...] = ()) -> Callable[..., tuple]:
    """Return f(u, s, parameters) -> (T + V, P, M, c, D) of one part, derived once for all processes of a run.

    `part` is "base", "wheels", "slosh", "link<i>" or "panel:<variant>"; `axes` are the arm's joint axes.
    P (18,), M (18, 18), c (18,) are nested lists of floats; D = 2 F is the power lost [W].
    """
    folder = os.environ.get("SMSID_CACHE")
    if not folder:
        return _differentiated(part, axes)
    written = Path(__file__).read_bytes() + sp.__version__.encode()
    digest = hashlib.sha256(written + repr((part, axes)).encode()).hexdigest()
    file = Path(folder) / "twins" / f"{digest[:24]}.py"
    if not file.is_file():
        text = inspect.getsource(_differentiated(part, axes))
        file.parent.mkdir(parents=True, exist_ok=True)
        whole = file.with_suffix(f".{os.getpid()}")
        whole.write_text(text, encoding="utf-8")
        whole.replace(file)
    names: dict[str, Any] = {**vars(math), "cos": _cos, "sin": _sin}
    exec(compile(file.read_text(encoding="utf-8"), str(file), "exec"), names)
    return names["_lambdifygenerated"]


def _differentiated(part: str, axes: tuple[str, ...]) -> Callable[..., tuple]:
    """Differentiate one part's energies."""
    if part.startswith("link"):
        kinetic, potential, dissipation, parameters = link(int(part[4:]), axes)
    elif part.startswith("panel:"):
        kinetic, potential, dissipation, parameters = panel(part[6:])
    else:
        kinetic, potential, dissipation, parameters = {"base": base, "wheels": wheels, "slosh": slosh}[part]()
    momenta = sp.Matrix([sp.diff(kinetic, u) for u in U])
    mass = momenta.jacobian(U)
    bias = momenta.jacobian(S) * sp.Matrix(U[6:])
    linear, angular = sp.Matrix(momenta[:3]), sp.Matrix(momenta[3:6])
    gyroscopic = [*W.cross(linear), *(W.cross(angular) + V.cross(linear))]
    forces = [
        sp.diff(potential - kinetic, s) + sp.diff(dissipation, u) for s, u in zip(S, U[6:], strict=True)
    ]
    bias += sp.Matrix([*gyroscopic, *forces])
    outputs = (kinetic + potential, list(momenta), mass.tolist(), list(bias), 2 * dissipation)
    return sp.lambdify([U, S, parameters], outputs, modules=[{"cos": _cos, "sin": _sin}, "math"], cse=True)
