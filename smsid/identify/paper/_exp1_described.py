"""What Exp. 1 leaves as described, parameter by parameter, with the reason; and recordings it is not in."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from smsid.effects.assembly import AppendageJoints
from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import ParameterEstimate, classify
from smsid.identify.paper._exp1_result import participates, participation_along
from smsid.identify.paper._translation import AxisData, AxisEstimate
from smsid.identify.stationary_joints import is_constant
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

AXES = "xyz"
MOTION = ("encoder", "tachometer")
SEE_NOTES = "not found: the notes say more; stays as described"


def check_possible(axis: AxisEstimate) -> None:
    """Raise `NotIdentifiableError` for an axis' estimate of one tank that nothing can have.

    Several tanks may share what they have in a way that cannot be, and the total mass be right.
    """
    for name, value in zip(axis.names, axis.values, strict=True):
        if (name in ("m_s", "k_s") or name.startswith("rho")) and not value > 0.0:
            raise NotIdentifiableError(
                f"{name} along {axis.axis} comes out as {value:.3g}, which is impossible.",
                advice="Noise hides it, or thrust and acceleration contradict each other.",
                hidden=True,
            )


def check_length(model: SpacecraftModel, data: AxisData, found: AxisEstimate) -> None:
    """Raise `NotIdentifiableError` for an axis taken as printed from less than a period of its slosh."""
    k, tanks = AXES.index(data.axis), [s.tank for s in model.slosh]
    softest = 1e-12  # [N/m], of a tank without springs
    periods = [2.0 * np.pi * float(np.sqrt(e.mass / max(e.stiffness[k], softest))) for e in tanks]
    length = float(data.time[-1] - data.time[data.before])
    if found.note and length < max(periods):
        raise NotIdentifiableError(
            f"The record of {length:.3g} s is shorter than a period of the slosh along {data.axis}.",
            advice=f"Record at least {max(periods):.3g} s.",
            hidden=True,
        )


def left_as_described(
    model: SpacecraftModel, found: Collection[str], reasons: Mapping[str, str]
) -> list[ParameterEstimate]:
    """Return mass, tanks' and appendages' parameters that are not among ``found`` names, none identifiable.

    ``reasons`` says of an axis why it gave nothing.
    """
    out = []

    def add(name: str, value: float, unit: str, group: str, axes: Sequence[str]) -> None:
        if name not in found:
            known = [reasons[a] for a in axes if a in reasons]
            note = f"{'; '.join(known)}: stays as described" if known else SEE_NOTES
            out.append(classify(name, value, unit, math.inf, group, nominal=value, note=note))

    add("total.mass", model.mass, "kg", "exp1", AXES)
    for tank in (s.tank for s in model.slosh):
        add(f"{tank.name}.mass", tank.mass, "kg", "exp1", AXES)
        for k, axis in enumerate(AXES):
            add(f"{tank.name}.stiffness.{axis}", tank.stiffness[k], "N/m", "exp1", axis)
            add(f"{tank.name}.damping.{axis}", tank.damping[k], "N s/m", "exp1", axis)
    for joints in model.appendages:
        part, bending = joints.appendage, [a for k, a in enumerate(AXES) if participates(joints, k)]
        heavy = part.mass_parameter()
        add(heavy.name, heavy.value, heavy.unit, "exp1", bending)
        for k, mode in enumerate(part.modal_data(), start=1):
            main = _main_axis(joints)
            add(f"{part.name}.mode{k}.frequency", mode.frequency, "Hz", "modes", main)
            add(f"{part.name}.mode{k}.damping", mode.damping, "1", "modes", main)
    return out


def _main_axis(joints: AppendageJoints) -> str:
    """The axis that shakes an appendage most."""
    return AXES[int(np.argmax([np.abs(participation_along(joints, k)).max(initial=0.0) for k in range(3)]))]


def check_moves(model: SpacecraftModel, recording: Recording) -> None:
    """Refuse a recording without thrust in which neither a joint nor a wheel moves: it tells nothing.

    Raises `NotIdentifiableError` with the reason per axis.
    """
    sensors = model.description.effective_sensors()
    told = [c for s in sensors if s.kind in MOTION for c in s.channels if c in recording]
    if any(not is_constant(x) for c in told for x in recording[c].T):
        return
    commanded = "command.force" in recording
    if not told and not commanded:
        return  # what is missing is told by name
    why = "'command.force' is zero there" if commanded else "there is no channel 'command.force'"
    moves = "no joint or wheel moves" if told else "encoders and tachometers are not recorded"
    reasons = {a: f"no thrust along {a} ({why})" for a in AXES}
    raise NotIdentifiableError(
        f"'{recording.name}' identifies nothing: {'; '.join(reasons.values())}. As Exp. 2 it tells nothing "
        f"either: {moves}.",
        advice="Fly Exp. 1 with thrust along at least one body axis, or Exp. 2 with wheels and arm.",
        reasons=reasons,
        unexcited=True,
    )
