"""Diagnosis of a welded arm from measured joint torques: verdict, causes, gain and what remains."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from smsid.arm.identify import rigid_arm
from smsid.arm.input_checks import wrong_column
from smsid.description import Description
from smsid.diagnose.result import Diagnosis, FoundCause, Limit, Value, Verdict
from smsid.diagnose.specification_tests import SpecificationTest
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.torque._dependence import dependences
from smsid.diagnose.torque._equations import TorqueEquations, require_excitation, torque_equations
from smsid.diagnose.torque._fit import TorqueFit, moved_values, term_columns
from smsid.diagnose.torque._known import described_values, extended_description, links_known, prior_of
from smsid.diagnose.torque.candidates import torque_candidates
from smsid.diagnose.torque.search import LEVELS, TorqueCause, TorqueSearch, search_torques
from smsid.diagnose.validation import ChannelGain, Gain
from smsid.diagnose.verdict import alias, describe, is_sibling, test_results
from smsid.effects.friction import frictions_of
from smsid.errors import RecordingError, SmsidError
from smsid.identify.estimate import Estimate
from smsid.model.regressor import Regressor
from smsid.recording import Recording

UNEXCITED = ("values are by whitened equations: not all combinations are known or excited",)


def torques_were_measured(description: Description, recording: Recording) -> bool:
    """Whether a recording is one of a welded arm whose torques were measured and not commanded."""
    found = [c for c in recording.channels if c.endswith(".joint_torque") and not c.startswith("truth.")]
    return description.root == "fixed" and bool(found) and "command.joint_torque" not in found


def diagnose_torques(
    description: Description,
    recordings: Sequence[Recording],
    *,
    estimate: Estimate | None = None,
    validation: Sequence[Recording] = (),
    cutoff: float | None = None,
) -> tuple[Diagnosis, Description, TorqueSearch]:
    """Say what the torques of an arm ask for beyond its links; with the extended description.

    The links' combinations are identified along with the causes unless an estimate says how well they are
    known. Causes are significant after correction, predict stretches of the recording they were not fitted
    to, and couplings show at each of their joints; they are therefore named also where something else is
    left, which `remaining` lists and the verdict ``unexplained`` says.

    Args:
        description: a welded arm.
        recordings: angles and torques; all are searched together.
        estimate: standard deviations of the combinations.
        validation: recordings the gain is measured on.
        cutoff: low-pass of the motion [Hz]; default as `motion_cutoff`.

    Raises:
        RecordingError: the recording cannot be used, has a wrong sign or column, or is of another arm.
    """
    begin = time.process_time()
    for recording in recordings:
        recording.check()
    together = ", ".join(r.name for r in recordings)
    equations = torque_equations(description, recordings, cutoff=cutoff)
    require_excitation(equations, together)
    _require_columns(description, recordings)
    count, least = len(equations.time), THRESHOLDS.torque_shortest
    if count < least:
        raise RecordingError(
            f"'{together}' gives {count} instants; a diagnosis needs {least}.",
            advice="Record longer, or raise the cutoff.",
        )
    prior, stated, notes = prior_of(equations, estimate)
    candidates = torque_candidates(equations, recordings[0], known=links_known(equations, prior))
    found = search_torques(equations, recordings, prior, candidates)
    last = found.last
    if not found.scores and not found.causes:
        raise RecordingError(f"'{together}' excites no candidate at all.", advice="Move the joints.")
    left_over = float(np.linalg.norm(found.values.residual) / np.linalg.norm(last.equations.torque))
    if left_over > THRESHOLDS.torque_foreign:
        raise RecordingError(
            f"Even with everything refitted, {100 * left_over:.0f} % of the torque is left unexplained.",
            advice="Is it of another arm? `smsid inspect --description` looks for turned signs and currents.",
            recording=together,
        )
    searched = time.process_time()
    blocks = dependences(last)
    before = dependences(found.nominal) if found.causes else blocks
    left = [b for b in blocks if b.p_value * len(blocks) < LEVELS.block]
    open_ = {b.location for b in left}
    named = tuple(cause_of(found, c, shaped=not open_ & set(c.term.candidate.joints)) for c in found.causes)
    extended, more = extended_description(found.values) if named else (description, ())
    gained, reason = None, "no validation recording was given"
    if validation:
        try:
            gained, reason = torque_gain(found, validation[0]), ""
        except SmsidError as error:
            reason = f"not on '{validation[0].name}': {error.message}"
    decided, sentence = _verdict(named, left, left_over)
    whitened = {
        name: float(np.sqrt(np.mean(f.left[: f.rows] ** 2)))
        for name, f in (("nominal", found.nominal), ("extended", last))
    }
    result = Diagnosis(
        description=description.name,
        recordings=tuple(r.name for r in (*recordings, *validation)),
        verdict=decided,
        sentence=sentence,
        priors=stated,
        causes=named,
        gain=gained,
        gain_reason=reason,
        remaining=test_results(left, len(blocks)),
        tests={
            "nominal": test_results(before, len(before)),
            "extended": test_results(blocks, len(blocks)),
        },
        limits=torque_limits(found),
        whitened_rms=whitened,
        timing={"search": searched - begin, "tests": time.process_time() - searched},
        notes=(
            f"residual: measured torque minus the model's at the measured motion; motion low-passed at "
            f"{equations.motion.cutoff:.4g} Hz, torques compared up to {equations.band:.4g} Hz",
            "noise: what no candidate at all explains, an autoregression per joint",
            *(UNEXCITED if found.values is last else ()),
            *_urdf_friction(equations),
            *notes,
            *more,
        ),
    )
    return result, extended, found


def _require_columns(description: Description, recordings: Sequence[Recording]) -> None:
    """Raise `RecordingError` for a sign, unit or order of joints that is wrong beyond doubt.

    The causes that fit such a recording best are at other joints, which are healthy.
    """
    if not np.any(Regressor(rigid_arm(description)).parameters):
        return
    for recording in recordings:
        doubt = wrong_column(description, recording)
        if doubt is not None:
            raise RecordingError(
                f"'{recording.name}' has a wrong column. {doubt.told}.",
                advice=doubt.mend,
                recording=recording.name,
                joint=doubt.joint,
                kind=doubt.kind,
                before=doubt.before,
                after=doubt.after,
            )


def cause_of(found: TorqueSearch, cause: TorqueCause, *, shaped: bool = True) -> FoundCause:
    """Return a cause in the form of the result, its values at the last fit.

    ``shaped``: whether its shape may be claimed; not where its joint's equation still lacks something.
    """
    own = cause.term.candidate
    values, sigma = found.values.term_values(cause.term)
    nominal: dict[str, float] = {}
    if own.moves:
        values = values + moved_values(cause.term)
        if own.moves == "tilt":
            nominal = dict.fromkeys(cause.term.names, 0.0)
        described = found.nominal.equations.description.effect
        nominal |= {p.name: p.value for e in described for p in e.parameters()}
    units = [own.units[i] for i in cause.term.kept]
    parameters = tuple(
        Value(n, float(x), float(s), u, nominal.get(n))
        for n, x, s, u in zip(cause.term.names, values, sigma, units, strict=True)
    )
    siblings = [s for s, _ in cause.aliases if is_sibling(s.candidate, own)]
    aliases = tuple(alias(own, s.candidate, c) for s, c in cause.aliases)
    return FoundCause(
        effect=own.kind,
        location=own.location,
        family=own.family,
        shape=None if siblings or not shaped else own.shape,
        parameters=parameters,
        aliases=aliases,
        evidence={
            "likelihood_ratio": cause.score.ratio,
            "freedom": float(cause.score.freedom),
            "p_value": float(min(1.0, cause.score.p_value * found.candidates)),
            "information_gain": cause.score.gain(found.last.samples),
        },
        fitted=own.shape,
    )


def _verdict(
    named: tuple[FoundCause, ...], left: Sequence[SpecificationTest], share: float
) -> tuple[Verdict, str]:
    words = "; ".join(describe(c) for c in named)
    if left:
        worst = left[0]
        sentence = (
            f"{100 * share:.3g} % of the torque is left, and {worst.where} still depends on "
            f"{worst.dependence}: no candidate explains that."
        )
        return "unexplained", sentence + (f" Found beside it: {words}." if words else "")
    if named:
        return "explained", f"The model lacks {words}."
    return "adequate", "The model explains the torques to what no candidate explains better."


def torque_limits(found: TorqueSearch) -> tuple[Limit, ...]:
    """Return the detection limits of the candidates that were not named: 95 % power, nuisances free."""
    needed = LEVELS.detectable(found.candidates)
    out, seen = [], set()
    for s in found.scores:
        c = s.candidate
        if c.key in seen:
            continue
        seen.add(c.key)
        sigma = np.sqrt(np.diag(s.covariance))
        out += [
            Limit(c.kind, c.location, c.shape, c.names[k], needed * float(x), c.units[k])
            for k, x in zip(s.kept, sigma, strict=True)
        ]
    return tuple(out)


def torque_gain(found: TorqueSearch, recording: Recording) -> Gain:
    """Return what the causes gain on a recording that was not searched.

    As given: the description's values. Channels are the torques of the joints within the band [N m] and,
    relative to the measured ones, those of all; noise is the white noise of the torque signal.

    Raises:
        RecordingError: as `torque_equations`.
    """
    nominal, last = found.nominal, found.values
    fits = {"given": nominal, "nominal": nominal, "extended": last}
    left: dict[str, np.ndarray] = {}
    equations = nominal.equations
    for name, fit in fits.items():
        own = fit.equations
        equations = torque_equations(
            own.description, recording, cutoff=own.motion.cutoff, band=own.band, late=own.late
        )
        x = described_values(own) if name == "given" else fit.x
        left[name] = equations.torque - predict_torques(fit, equations, x)
    white = {n: fits[n].whitening.apply(r, equations.near_rest).ravel() for n, r in left.items()}
    rms = {n: float(np.sqrt(np.mean(w**2))) for n, w in white.items()}
    excess = {n: float(np.sum(w**2)) - w.size for n, w in white.items()}
    size = float(np.linalg.norm(equations.torque))
    channels = [
        ChannelGain(
            f"torque of {joint}", "N m",
            float(np.sqrt(np.mean(left["given"][:, j] ** 2))),
            float(np.sqrt(np.mean(left["extended"][:, j] ** 2))),
            float(equations.noise[j]),
        )
        for j, joint in enumerate(equations.names)
    ]  # fmt: skip
    floor = float(np.sqrt(np.sum(equations.noise**2) * len(equations.torque)) / size)
    given, extended = (float(np.linalg.norm(left[n])) / size for n in ("given", "extended"))
    channels.append(ChannelGain("torque of all joints, relative", "1", given, extended, floor))
    return Gain(
        recording.name, white["given"].size, rms["given"], rms["nominal"], rms["extended"],
        excess["given"], excess["nominal"], excess["extended"], tuple(channels),
    )  # fmt: skip


def predict_torques(fit: TorqueFit, equations: TorqueEquations, x: np.ndarray) -> np.ndarray:
    """Return the torques (n, joints) a fit's combinations and terms give on other equations [N m]."""
    b = equations.rows.shape[2]
    if len(x) == b:
        return equations.rows @ x
    load = equations.fine @ x[:b]
    for _ in range(3):
        load = equations.fine @ x[:b] + term_columns(equations, fit.terms, load) @ x[b:]
    return equations.rows @ x[:b] + equations.filtered(term_columns(equations, fit.terms, load)) @ x[b:]


def _urdf_friction(equations: TorqueEquations) -> tuple[str, ...]:
    """Return a note where the URDF states a friction: here that is sought from nothing."""
    source = equations.model.source
    listed = frictions_of(equations.description.effect)
    stated = [j for j in equations.names if source is not None and j in source.losses and j not in listed]
    if not stated:
        return ()
    names = ", ".join(stated)
    return (f"friction that the URDF states is not taken for known ({names}): what is found is all of it",)
