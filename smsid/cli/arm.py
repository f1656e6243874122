"""``smsid identify`` for a welded arm."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smsid._statistics import NORMAL95
from smsid.arm.comparison import JudgedArm
from smsid.arm.identify import identify_arm, rigid_arm
from smsid.arm.input_checks import joint_doubts
from smsid.arm.presets import with_friction_laws, with_joint_effects
from smsid.arm.readings import with_passive_joints
from smsid.arm.servo import identify_servos, is_of_servos
from smsid.arm.setup import held_joints
from smsid.arm.torque_calibration import torque_scales, with_signal_gears, with_torque_gains
from smsid.cli.inputs import write_page
from smsid.cli.output import note_lines, print_parts, say, show_spinner
from smsid.cli.tables import estimate_parts, plain_table
from smsid.description import Description
from smsid.effects import BaseTilt
from smsid.effects.external import tilt_of
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.identify.estimate import save_estimate
from smsid.model.regressor import Regressor
from smsid.recording import Recording
from smsid.report.arm import arm_report


def identify_and_judge(
    description: Description,
    recordings: Sequence[Recording],
    output: Path,
    cutoff: float | None,
    *,
    gains: Sequence[str] = (),
    hold: Sequence[str] = (),
    usual: bool = False,
    friction: Sequence[str] = (),
    level: bool = False,
    equal_errors: bool = False,
    passive: Sequence[str] = (),
    report: Path | None = None,
    inputs: Sequence[Path] = (),
    everything: bool = False,
) -> list[dict[str, Any]]:
    """Identify from all recordings but those in the role validation, judge by all of them, and print.

    Returns for each recording how far its torques are predicted.

    The torque gains of the joints that the patterns ``gains`` fit are found first, the described links taken
    as known; the torque signal of a joint whose gain cannot be told is not used. ``hold`` are patterns of
    joints that do not move, see `smsid.arm.setup.held_joints`; no motor drives joints that the patterns
    ``passive`` fit, see `smsid.arm.readings.with_passive_joints`. With ``usual`` every joint gets friction,
    offset, and a rotor, or a spring if nothing drives it; ``friction`` names more laws, see
    `smsid.arm.with_friction_laws`; with ``level`` gravity's direction is found as well; ``equal_errors``: as
    `identify_arm` has it. ``report``: an HTML to write as well, with the sums of the files ``inputs``.

    Recordings of commands and encoders without torques are those of servos, see
    `smsid.arm.servo.identify_servos`; torques are then position errors times stiffness.

    Raises:
        RecordingError: no recording to identify from, or as `identify_arm`.
        DescriptionError: as `identify_arm`.
        NotIdentifiableError: as `identify_arm`.
    """
    train = [r for r in recordings if r.role != "validation"]
    if not train:
        raise RecordingError(
            "No recording to identify from was given for an arm.",
            advice="Those in the role validation are only judged by.",
            recordings=tuple(r.name for r in recordings),
        )
    held = held_joints(rigid_arm(description).arm_joints.names, hold)
    joints = rigid_arm(description, held).arm_joints.names
    idle = tuple(held_joints(joints, passive, option="--passive"))
    if idle:
        recordings = [with_passive_joints(r, idle) for r in recordings]
        train = [r for r in recordings if r.role != "validation"]
    if usual:
        driven = [j for j in joints if j not in idle]
        description = with_joint_effects(description, joints, "joint_friction", "torque_offset")
        description = with_joint_effects(description, driven, "motor_inertia")
        description = with_joint_effects(description, idle, "joint_cable")
    if friction:
        description = with_friction_laws(description, joints, friction)
    if level and tilt_of(description.effect) is None:
        description = description.with_effects(BaseTilt(name="base_tilt"))
    found: JudgedArm
    untold: tuple[str, ...] = ()
    gain_sigma: dict[str, float] = {}
    servos = is_of_servos(recordings)
    if gains and servos:
        raise RecordingError(
            "The recordings hold no torque signals, but commands of servos: there is no gain to find.",
            advice="Leave --gains and --gain out.",
        )
    if equal_errors and servos:
        raise RecordingError(
            "The recordings hold no torque signals, but commands of servos, whose errors are taken "
            "for equally large anyway.",
            advice="Leave --equal-errors out.",
        )
    if gains:
        unknown = [j for j in held_joints(joints, gains, option="--gain") if j not in idle]
        description, recordings = with_signal_gears(description, recordings, joints)
        train = [r for r in recordings if r.role != "validation"]
        description, untold, gain_sigma = _with_gains(description, train[0], cutoff, held, unknown)
    with show_spinner("identifying the arm"):
        if servos:
            description = with_joint_effects(description, joints, "servo")
            found = identify_servos(description, train, cutoff=cutoff, hold=held)
        else:
            found = identify_arm(
                description,
                train,
                cutoff=cutoff,
                hold=held,
                without=untold,
                gain_sigma=gain_sigma,
                equal_errors=equal_errors,
            )
        judged = [(r.name, r.role, found.judge(r)) for r in recordings]
    save_estimate(found.estimate, output)
    others = [r for r in recordings if r is not train[0]]
    write_page(report, lambda o: arm_report(found, [train[0], *others], o), inputs)
    print_parts(estimate_parts(found.estimate, everything=everything))
    _print_judgement(found, judged)
    if not servos and np.any(Regressor(found.model).parameters):
        for doubt in joint_doubts(description, train[0], cutoff=cutoff, hold=held):
            say(f"doubt: {doubt.sentence}", style="yellow")
    for line in note_lines(found.estimate.notes, everything=everything):
        say(line)
    say(f"identified in {found.estimate.timing['total']:.1f} s")
    return [
        {"recording": name, "role": role, "relative": e.relative, "by_joint": dict(e.by_joint)}
        for name, role, e in judged
    ]


def _with_gains(
    description: Description,
    recording: Recording,
    cutoff: float | None,
    held: Mapping[str, float],
    unknown: Collection[str],
) -> tuple[Description, tuple[str, ...], dict[str, float]]:
    """Return the description with those of the unknown gains that can be told, the other joints, and the
    gains' relative standard deviations; print all of them.

    Raises:
        NotIdentifiableError: no joint's gain is known.
    """
    scales = torque_scales(description, recording, cutoff=cutoff, hold=held)
    scales = tuple(s for s in scales if s.joint in unknown)
    for s in scales:
        if s.is_significant:
            spread = NORMAL95 * s.sigma / s.value**2
            sentence = f"{s.gain:.4g} +- {spread:.2g} N m per unit of signal, times the described gain"
            sentence += "; negative: the motor is counted the other way" if s.value < 0.0 else ""
        else:
            sentence = "gain not told: neither gravity nor inertia shows in its torque, which is not used"
        say(f"{s.joint}: {sentence}")
    untold = tuple(s.joint for s in scales if not s.is_significant)
    if len(untold) == len(rigid_arm(description, held).arm_joints):
        raise NotIdentifiableError(
            "No joint's gain can be told.", advice="Move the joints so that gravity or inertia shows."
        )
    sure = [s for s in scales if s.is_significant]
    return with_torque_gains(description, sure), untold, {s.joint: s.sigma / abs(s.value) for s in sure}


def _common_prefix(names: Sequence[str]) -> str:
    """Return how all names begin, up to an underscore: ``panda_`` of ``panda_joint1`` and so on."""
    alike = itertools.takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join("".join(x[0] for x in alike).rpartition("_")[:2]) if len(names) > 1 else ""


def _print_judgement(found: JudgedArm, judged: Sequence[tuple[str, str, Any]]) -> None:
    names = list(judged[0][2].by_joint)
    before, after = _common_prefix(names), _common_prefix([n[::-1] for n in names])[::-1]
    table = plain_table(
        *("recording", "role", "all joints", *(n.removeprefix(before).removesuffix(after) for n in names)),
        title="torques: |predicted - measured| / |measured|"
        + (f", joints '{before}...{after}'" if before + after else ""),
        left=("recording", "role"),
    )
    for name, role, errors in judged:
        table.add_row(name, role, f"{errors.relative:.4f}", *(f"{x:.3f}" for x in errors.by_joint.values()))
    print_parts([table])
    for sentence in found.verdict():
        say(sentence)
