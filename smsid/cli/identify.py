"""``smsid identify``: from recordings to an identified spacecraft or arm."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import print_estimate, read_recordings, write_page
from smsid.cli.options import DescriptionPath, EstimateOutput, ReportPath, ShowAll, Unchecked
from smsid.cli.output import say, show_spinner
from smsid.cli.places import Writes
from smsid.errors import SmsidError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from smsid.description import Description
    from smsid.estimation.flight import FlightOptions
    from smsid.recording import Recording
    from smsid.report import Provenance, Report

Method = Literal["ml", "filter", "paper"]
Drive = Literal["auto", "command", "measured"]


def identify_command(
    description: DescriptionPath,
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            help="flights of any kind, the paper's experiments or others; of an arm that is welded to the "
            "ground: those to identify from, and any in the role validation to judge by"
        ),
    ] = None,
    output: EstimateOutput = Path("estimate.json"),
    method: Annotated[
        Method,
        typer.Option(
            help="ml: maximum likelihood, started from the paper's method where the recordings are its two "
            "experiments, else by a filter; filter: that in any case; paper: the linear method alone. Of a "
            "welded arm ml fits equations of torques, and filter the motion under commanded torques, which "
            "is taken as well where a listed effect does not enter torques linearly"
        ),
    ] = "ml",
    cad: Annotated[
        float | None,
        typer.Option(
            metavar="SIGMA",
            min=1e-6,
            help="how well the URDF's masses, first moments and inertias are known beforehand: standard "
            "deviation relative to the body's size (0.05: 5 %); only as wide priors if left out",
        ),
    ] = None,
    drive: Annotated[
        Drive,
        typer.Option(
            help="by a filter: joints and wheels follow their `measured` motion, or the torque of their "
            "`command`; auto: the motion, unless a listed effect has to do with the motor's torque"
        ),
    ] = "auto",
    at_rest: Annotated[
        bool, typer.Option("--at-rest", help="by a filter: nothing moves when a recording begins")
    ] = False,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=SIGMA,...",
            help="by a filter: standard deviations at the start of what no sensor reads then: position [m], "
            "attitude [rad], velocity [m/s], rate [rad/s], joint_angle, joint_rate, wheel_rate",
        ),
    ] = None,
    cutoff: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            help="welded arm: up to where torques are compared [Hz]; found from the data if left out",
        ),
    ] = None,
    gains: Annotated[
        bool,
        typer.Option(
            "--gains", help="welded arm: first find the gain of every torque signal from the described links"
        ),
    ] = False,
    gain: Annotated[
        list[str] | None,
        typer.Option(help="welded arm: the same for some joints only, such as 'wrist_*'; others are in N m"),
    ] = None,
    rigid: Annotated[
        bool,
        typer.Option(
            "--rigid",
            help="arm without a TOML: links alone, without friction, rotors and offsets of its joints",
        ),
    ] = False,
    robot: Annotated[
        str | None,
        typer.Option(help="arm by its name in example-robot-data, such as panda, instead of a description"),
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option(help="welded arm: joint that did not move and was not measured, 'hand_*' or lift=0.1"),
    ] = None,
    passive: Annotated[
        list[str] | None,
        typer.Option(
            help="welded arm: joint without a motor, such as 'flex*', that stands for a gear or a link that "
            "bends: its position is the measured deflection, its torque zero; it gets a spring"
        ),
    ] = None,
    friction: Annotated[
        list[str] | None,
        typer.Option(
            help="welded arm: more of friction to identify than viscous and Coulomb: direction, quadratic, "
            "cubic, stribeck, load, position or temperature, of all joints or as in stribeck=shoulder_*",
        ),
    ] = None,
    level: Annotated[
        bool,
        typer.Option(
            "--level", help="welded arm: find gravity's direction as well, the base may not be level"
        ),
    ] = False,
    equal_errors: Annotated[
        bool,
        typer.Option(
            "--equal-errors",
            help="welded arm: errors are as large near rest and at reversals as elsewhere, as published "
            "studies take them; otherwise they count as large as they are",
        ),
    ] = False,
    modal: Annotated[
        Literal["smoother", "printed"] | None,
        typer.Option(
            help="--method paper: bending in Exp. 2 by a Kalman smoother (smoother, the default) or by "
            "integrating the accelerometers as the paper prints it, (31)-(32) (printed)"
        ),
    ] = None,
    tracked_point: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="where the pose sensor sits, the tracked point P, in the bus frame [m], instead of the "
            "description's; an IMU at the same place goes with it",
        ),
    ] = None,
    find_tracked_point: Annotated[
        bool,
        typer.Option(
            "--find-tracked-point",
            help="--method paper: take P, r_p/b of the paper, for unknown and find it from Exp. 2",
        ),
    ] = False,
    show_all: ShowAll = False,
    unchecked: Unchecked = False,
    report: ReportPath = None,
    states: Annotated[
        Path | None,
        typer.Option(
            help="recording to write as well of what no sensor saw: slosh, modes and biases with standard "
            "deviations; identifies by the filter (--method filter)",
        ),
        Writes((".nc",)),
    ] = None,
) -> CommandResult:
    """Identify a spacecraft from recordings; the description's values are only the starting guess."""
    from smsid.description import load_description
    from smsid.estimation.identify import identify_by_the_paper, identify_spacecraft
    from smsid.identify.estimate import save_estimate
    from smsid.identify.paper.pose_point import with_tracked_point

    files = [description, *(recordings or [])] if robot else list(recordings or [])
    if not files:
        raise SmsidError("No recording was given.", advice="Name one or more after the description.")
    bare = robot is not None or description.suffix == ".urdf"
    described = None if bare else load_description(description)
    loaded = read_recordings(files, unchecked)
    described = described or _bare_description(description, robot, loaded)
    given = {
        "--cad": cad is not None, "--states": states is not None, "--modal": modal is not None,
        "--find-tracked-point": find_tracked_point, "--tracked-point": tracked_point is not None,
        "--cutoff": cutoff is not None, "--gains": gains, "--gain": gain, "--hold": hold, "--rigid": rigid,
        "--friction": friction, "--level": level, "--equal-errors": equal_errors, "--passive": passive,
        "--at-rest": at_rest, "--start": start is not None, "--drive": drive != "auto",
    }  # fmt: skip
    by_motion = ""
    if described.root == "fixed":
        from smsid.estimation.arm_motion import identify_arm_motion, why_by_motion

        by_motion = why_by_motion(described, "filter" if states is not None and method == "ml" else method)
    kind = method if described.root == "free" else MOTION[0] if by_motion else ARM[0]
    _check_options([option for option, value in given.items() if value], kind, by_motion)
    _check_arm_method(kind, method, drive, bare=bare)
    taken = [r for r in loaded if kind not in MOTION or r.role != "validation"] or loaded
    idle = [r.name for r in loaded if not any(r is one for one in taken)]
    loaded = taken
    if tracked_point is not None:
        described = with_tracked_point(described, _point(tracked_point))
    method = "filter" if states is not None else method  # what was hidden is estimated by it
    if kind == ARM[0]:
        from smsid.cli.arm import identify_and_judge

        inputs = files if robot else (description, *files)
        judged = identify_and_judge(
            described, loaded, output, cutoff, gains=("*",) if gains else gain or (),
            hold=hold or (), usual=bare and not rigid, friction=friction or (), level=level,
            equal_errors=equal_errors, passive=passive or (), report=report, inputs=inputs,
            everything=show_all,
        )  # fmt: skip
        document = {"estimate": json.loads(output.read_text(encoding="utf-8")), "torque_errors": judged}
        return CommandResult(document, [output, *([report] if report else [])])
    with show_spinner("identifying") as tell:
        if modal is not None or find_tracked_point:
            found = identify_by_the_paper(
                described, loaded, printed=modal == "printed", find_point=find_tracked_point
            )
        elif by_motion:
            described = _with_friction(described, friction or ())
            flight = _flight("auto", at_rest, start)
            found = identify_arm_motion(
                described, loaded, reason=by_motion, cad=cad, options=flight, tell=tell
            )
        else:
            flight = _flight(drive, at_rest, start)
            found = identify_spacecraft(described, loaded, method=method, cad=cad, options=flight, tell=tell)
    estimate, linear = found.estimate, found.linear
    seconds = estimate.timing["total"] + (linear.estimate.timing["total"] if found.refined and linear else 0)
    save_estimate(estimate, output)

    def page(origin: Provenance) -> Report:
        from smsid.report.identify import flights_report, identify_report

        if found.linear is None:
            return flights_report(described, found, origin)
        return identify_report(described, loaded, found.linear, found.refined, origin)

    made = write_page(report, page, [description, *files], described)
    more = linear.estimate.notes if linear is not None and found.refined is not None else ()
    more = [n if n in estimate.notes else f"first guess, by the paper's method: {n}" for n in more]
    print_estimate(estimate, more, everything=show_all)
    if states is not None and found.flights is not None:
        from smsid.estimation.hidden_states import hidden_states
        from smsid.recording import save_recording

        with show_spinner("smoothing hidden states"):
            hidden = hidden_states(found.flights)
        save_recording(hidden, states)
    for name in idle:
        say(f"'{name}', in the role validation, took no part: `smsid diagnose --validate` measures its error")
    written = [output, *made, *([states] if states is not None else [])]
    say(f"identified in {seconds:.1f} s")
    return CommandResult({"estimate": json.loads(estimate.to_json())}, written)


def _bare_description(description: Path, robot: str | None, loaded: Sequence[Recording]) -> Description:
    """Return the description of a robot by its name, or of a URDF alone by what was recorded."""
    from smsid.arm.servo import is_of_servos
    from smsid.arm.setup import arm_description, is_of_an_arm
    from smsid.description import load_description

    if robot is not None:
        return arm_description(robot=robot)
    of_an_arm = is_of_an_arm(loaded) or is_of_servos(loaded)
    return arm_description(description) if of_an_arm else load_description(description)


SPACECRAFT, ML, PAPER = ("ml", "filter", "paper"), ("ml", "filter", "motion"), ("paper",)
ARM, MOTION, EITHER_ARM = ("arm",), ("motion",), ("arm", "motion")
ADVICE = {
    SPACECRAFT: ("spacecraft", "Leave it out."),
    ML: ("maximum likelihood of motion", "Leave it out, or use --method ml (filter, of a welded arm)."),
    PAPER: ("the paper's method of a spacecraft", "Add --method paper, or leave it out."),
    ARM: ("welded arms by their torques", 'Leave it out, or use --method ml with root = "fixed".'),
    EITHER_ARM: ("welded arms", 'Leave it out, or set root = "fixed".'),
}
"""What an option is for by the methods that take it, and what to do elsewhere."""
TAKEN_BY = {"--cad": ML, "--states": ML, "--modal": PAPER, "--find-tracked-point": PAPER}
TAKEN_BY |= dict.fromkeys(("--at-rest", "--start", "--drive"), ML)
TAKEN_BY |= {"--tracked-point": SPACECRAFT, "--friction": EITHER_ARM}  # others: ARM


def _check_options(options: list[str], kind: str, by_motion: str) -> None:
    """Raise `SmsidError` for an option that the machine or the method does not take."""
    for option in options:
        methods = TAKEN_BY.get(option, ARM)
        if kind not in methods:
            what, advice = ADVICE[methods]
            if by_motion:
                what, advice = f"{what}; this one is identified by its motion: {by_motion}", "Leave it out."
            raise SmsidError(f"{option} is for {what}.", advice=advice)


def _check_arm_method(kind: str, method: Method, drive: Drive, *, bare: bool) -> None:
    """Raise `SmsidError` for a method that a welded arm, described by its URDF alone if ``bare``, has not."""
    if kind not in EITHER_ARM:
        return
    if method == "paper":
        raise SmsidError("--method paper is for free-flying spacecraft.", advice="Leave it out.")
    if bare and kind in MOTION:
        raise SmsidError(
            "--method filter needs the noise of the encoders, of which a bare URDF says nothing.",
            advice='Write a TOML with the urdf, root = "fixed" and a [[sensor]] with its noise.',
        )
    if drive == "measured":
        raise SmsidError(
            "--drive measured is for spacecraft: where joints only follow their motion, nothing is told of a "
            "welded arm.",
            advice="Leave it out.",
        )


def _with_friction(described: Description, friction: Sequence[str]) -> Description:
    """Return an arm's description with further laws of ``friction``, as equations of torques take them."""
    from smsid.arm import with_friction_laws
    from smsid.arm.identify import rigid_arm

    if not friction:
        return described
    return with_friction_laws(described, rigid_arm(described).arm_joints.names, friction)


def _flight(drive: Drive, at_rest: bool, start: str | None) -> FlightOptions | None:
    """Return how a filter takes recordings, ``None`` for the defaults."""
    if drive == "auto" and not at_rest and start is None:
        return None
    from smsid.estimation.flight import FlightOptions  # the filter takes time to load
    from smsid.estimation.initial_state import InitialPrior

    known = [k for k, x in vars(InitialPrior()).items() if type(x) is float]
    sigmas: dict[str, float] = {}
    for name, _, sigma in (x.strip().partition("=") for x in start.split(",")) if start else ():
        try:
            sigmas[name] = float(sigma)
        except ValueError:
            sigmas[name] = 0.0
        if name not in known or not (isfinite(sigmas[name]) and sigmas[name] > 0.0):
            raise SmsidError(
                f"'{name}={sigma}' is no standard deviation at the start.",
                advice=f"Give one of {', '.join(known)}, such as attitude=0.02.",
            )
    return FlightOptions(drive=drive, initial=InitialPrior(at_rest=at_rest, **sigmas))  # type: ignore[arg-type]


def _point(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise SmsidError(
            f"--tracked-point '{text}' is no point.", advice="Give three numbers [m]: 0.5,1.5,0.6."
        ) from None
    if not all(isfinite(v) for v in (x, y, z)):
        raise SmsidError(f"--tracked-point '{text}' is not finite.", advice="Give three numbers [m].")
    return x, y, z
