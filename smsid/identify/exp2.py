"""Exp. 2 from recording to parameters: hidden states, Step A, Step B, with the slosh state and as printed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from smsid.effects.appendage import ModalAppendage
from smsid.effects.slosh import Slosh
from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import ParameterEstimate, judged
from smsid.identify.modal_state import integrate_accelerometers, smooth_modes
from smsid.identify.momentum import HiddenStates, Regression, StepA, carried_by_bus, step_a, step_b
from smsid.identify.momentum_printed import printed_parameters, step_b_printed
from smsid.identify.motion import Motion, prepare
from smsid.identify.robust import white_sigma
from smsid.identify.slosh_state import estimate_slosh
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

STILL = 1e-3  # [rad/s] joint or wheel rate below which nothing was excited


@dataclass(frozen=True)
class MomentumResult:
    """What Exp. 2 identified: Step A and B with the slosh state, and as printed beside them."""

    motion: Motion
    hidden: HiddenStates
    a: StepA
    b: Regression
    a_printed: StepA
    b_printed: Regression | None
    parameters: tuple[ParameterEstimate, ...]
    timing: dict[str, float]
    notes: tuple[str, ...] = ()
    conditions: dict[str, float] = field(default_factory=dict)


def identify_momentum(
    model: SpacecraftModel,
    recording: Recording,
    mass: float,
    *,
    cutoff: float | None = 2.0,
    rate: float | None = 20.0,
    modal: str = "smoother",
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    perturbed: Sequence[tuple[SpacecraftModel, float]] = (),
    described: SpacecraftModel | None = None,
) -> MomentumResult:
    """Identify inertial parameters from one recording of Exp. 2, starting at rest, without thrust.

    ``model`` carries what Exp. 1 found for slosh and appendages, ``mass`` is M [kg]. ``modal``: 'smoother' (with
    the identified modes) or 'printed' ((31)-(32) as printed). ``perturbed`` are the model and mass with one result of
    Exp. 1 after the other moved by its standard deviation: what that moves is added to the covariance. Raises `NotIdentifiableError` when the recording
    cannot identify inertia, saying why.
    """
    started = time.perf_counter()
    motion = prepare(model, recording, cutoff=cutoff, rate=rate)
    _check_excited(model, recording, motion)
    timing = {"Exp. 2: filtering": time.perf_counter() - started}

    def timed(label: str, since: float) -> float:
        now = time.perf_counter()
        timing[label] = now - since
        return now

    mark = time.perf_counter()
    hidden = hidden_states(model, recording, motion, modal)
    mark = timed("Exp. 2: slosh and modal states", mark)
    a = step_a(model, motion, hidden, mass)
    mark = timed("Exp. 2: Step A", mark)
    b = step_b(model, motion, hidden, mass, a.position, prior=prior)
    mark = timed("Exp. 2: Step B", mark)
    if perturbed:
        a, b = _with_carried_errors(model, recording, motion, mass, modal, perturbed, a, b)
        mark = timed("Exp. 2: errors carried over from Exp. 1", mark)
    without = HiddenStates({}, hidden.modes)
    a_printed = step_a(model, motion, without, mass)
    b_printed, notes = None, []
    try:
        slosh_mass = _slosh_mass(model)
        b_printed = step_b_printed(model, motion, without, mass, slosh_mass, a.position)
    except NotIdentifiableError as error:
        notes.append(f"Step B as printed: {error}")
    timed("Exp. 2: as printed", mark)
    parameters = [*_of_step_a(a), *_of_step_b(described or model, b)]
    if b_printed is not None:
        nominal = b_printed.base.values(printed_parameters(model, motion, without, _slosh_mass(model)))
        for name, value, sigma, unit, n in zip(
            b_printed.base.names, b_printed.values, b_printed.sigma, b_printed.base.units, nominal, strict=True
        ):
            parameters.append(judged(name, value, unit, sigma, "exp2.step_b_printed", nominal=float(n)))
    conditions = {"Exp. 2, Step A": a.moments.solution.condition, "Exp. 2, Step B": b.solution.condition}
    if b_printed is not None:
        conditions["Exp. 2, Step B as printed"] = b_printed.solution.condition
    return MomentumResult(
        motion, hidden, a, b, a_printed, b_printed, tuple(parameters), timing, tuple(notes), conditions
    )


def _with_carried_errors(
    model: SpacecraftModel,
    recording: Recording,
    motion: Motion,
    mass: float,
    modal: str,
    perturbed: Sequence[tuple[SpacecraftModel, float]],
    a: StepA,
    b: Regression,
) -> tuple[StepA, Regression]:
    """Add to the covariances what errors of Exp. 1's results do, one at a time, on every fourth sample."""
    coarse = motion.thinned(4)

    def both(m: SpacecraftModel, total: float) -> tuple[StepA, Regression]:
        hidden = hidden_states(m, recording, coarse, modal)
        first = step_a(m, coarse, hidden, total)
        return first, step_b(m, coarse, hidden, total, first.position)

    a0, b0 = both(model, mass)
    position = np.diag(a.position_sigma**2)
    moments, inertia = a.moments.solution.covariance.copy(), b.solution.covariance.copy()
    for other, total in perturbed:
        a1, b1 = both(other, total)
        if b1.base.names != b.base.names or a1.moments.base.names != a.moments.base.names:
            raise NotIdentifiableError(
                "The identifiable combinations change within the uncertainty of Exp. 1.",
                advice="Fly a richer Exp. 2: some combination is excited only marginally.",
                names=b.base.names,
            )
        position += np.diag((a1.position - a0.position) ** 2)
        moments += np.outer(*[a1.moments.values - a0.moments.values] * 2)
        inertia += np.outer(*[b1.values - b0.values] * 2)
    a = replace(
        a,
        position_sigma=np.sqrt(np.diag(position)),
        moments=replace(a.moments, solution=replace(a.moments.solution, covariance=moments)),
    )
    return a, replace(b, solution=replace(b.solution, covariance=inertia))


def hidden_states(model: SpacecraftModel, recording: Recording, motion: Motion, modal: str) -> HiddenStates:
    """Estimate slosh and modal states from the measured motion and the parameters in the model."""
    slosh, modes = {}, {}
    tanks = {e.name: e for e in model.description.effect if isinstance(e, Slosh)}
    for joint in model.slosh:
        tank = tanks[joint.name]
        slosh[joint.name] = estimate_slosh(
            motion, joint.position, tank.mass, np.array(tank.stiffness), np.array(tank.damping)
        )
    imu = float(np.sqrt(np.mean(white_sigma(motion.acceleration) ** 2)))
    for joints in model.appendages:
        name = joints.appendage.name
        seen = motion.panels.get(name)
        if modal == "printed" and seen is not None:
            modes[name] = integrate_accelerometers(motion, joints)
        else:
            noise = imu if seen is None else float(np.sqrt(np.mean(white_sigma(seen) ** 2)))
            modes[name] = smooth_modes(motion, joints, accelerometer=max(noise, 1e-9), imu=max(imu, 1e-9))
    return HiddenStates(slosh, modes)


def _slosh_mass(model: SpacecraftModel) -> float:
    return float(sum(model.pin.inertias[j.joint].mass for j in model.slosh))


def _check_excited(model: SpacecraftModel, recording: Recording, motion: Motion) -> None:
    if "command.force" in recording and np.abs(recording["command.force"]).max() > 1e-9:
        raise NotIdentifiableError(
            f"'{recording.name}' has thrust, so its momentum is not conserved: it is no Exp. 2.",
            advice="Fly Exp. 2 on wheels and arms only.",
        )
    speed = np.abs(motion.angle_rates).max(axis=0, initial=0.0)
    still = [n for n, s in zip(model.arm_joints.names, speed, strict=True) if s < STILL]
    if still and len(still) == len(model.arm_joints):
        raise NotIdentifiableError(
            f"No joint moves in '{recording.name}' (all below {STILL:g} rad/s): link inertias cannot be identified.",
            advice="Excite every joint of the arm; `smsid simulate DESC exp2` shows how.",
            speed=speed,
        )
    if np.abs(motion.wheel_rates).max(initial=0.0) < STILL:
        raise NotIdentifiableError(
            f"No wheel turns in '{recording.name}': without a known momentum, inertias are known only up to a factor.",
            advice="Spin the reaction wheels.",
        )


def _of_step_a(a: StepA) -> list[ParameterEstimate]:
    size = float(np.linalg.norm(a.position))
    found = [
        judged(f"system_cm.{axis}", a.position[k], "m", a.position_sigma[k], "exp2.step_a", reference=size,
               note="inertial axes at the start, from the bus origin then")
        for k, axis in enumerate("xyz")
    ]
    reg = a.moments
    return found + [
        judged(f"step A: {name}", value, unit, sigma, "exp2.step_a")
        for name, value, unit, sigma in zip(reg.base.names, reg.values, reg.base.units, reg.sigma, strict=True)
    ]


def _of_step_b(model: SpacecraftModel, b: Regression) -> list[ParameterEstimate]:
    regressor = Regressor(model)
    theta = regressor.parameters + carried_by_bus(model, regressor)
    nominal = b.base.values(theta[[regressor.names.index(n) for n in b.theta_names]])
    return [
        judged(name, value, unit, sigma, "exp2.step_b", nominal=float(n), reference=ref)
        for name, value, unit, sigma, n, ref in zip(
            b.base.names, b.values, b.base.units, b.sigma, nominal, references(b), strict=True
        )
    ]


def references(b: Regression) -> list[float | None]:
    """Return what a small parameter is judged against: the largest of its kind on its body, else None.

    Small: ``share`` of the measured momentum (column norm times value) below 1 %.
    """
    kinds = [_kind(name) for name in b.base.names]
    out: list[float | None] = []
    for i, kind in enumerate(kinds):
        if b.shares is None or b.shares[i] >= 0.01:
            out.append(None)
        else:
            peers = [abs(v) for v, other in zip(b.values, kinds, strict=True) if other == kind]
            out.append(float(max(peers)))
    return out


def _kind(name: str) -> tuple[str, str]:
    """Body and kind (mass, first moment, inertia) of a base parameter, from its leading term."""
    body, symbol = name.split(" ", 1)[0].rsplit(".", 1)
    return body, {"m": "mass"}.get(symbol, "inertia" if symbol.startswith("I") else "moment")


def identified_modes(appendage, factor: float, modes) -> ModalAppendage:  # noqa: ANN001
    """Return an appendage as modal data with identified frequencies and damping, and mass scaled by ``factor``.

    Participation factors scale with the root of the mass, mass-normalised shapes with one over it.
    """
    data = list(appendage.modal_data())
    root = float(np.sqrt(factor))
    for k, mode in enumerate(data):
        update = {
            "translation": tuple(root * x for x in mode.translation),
            "rotation": tuple(root * x for x in mode.rotation),
            "shape": tuple(tuple(x / root for x in s) for s in mode.shape),
        }
        if k < len(modes):
            update["frequency"] = modes[k].frequency
            update["damping"] = max(modes[k].damping, 0.0)
        data[k] = mode.model_copy(update=update)
    rigid = appendage.rigid_inertia()
    matrix = rigid.inertia + rigid.mass * (
        (rigid.lever @ rigid.lever) * np.eye(3) - np.outer(rigid.lever, rigid.lever)
    )
    about = factor * matrix
    return ModalAppendage(
        name=appendage.name,
        frame=appendage.frame,
        position=appendage.position,
        rpy=appendage.rpy,
        mass=factor * rigid.mass,
        center_of_mass=tuple(float(x) for x in rigid.lever),
        inertia=tuple(float(about[i, j]) for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))),
        mode=tuple(data),
        stations=tuple(tuple(float(x) for x in p) for p in appendage.station_positions()),
    )
