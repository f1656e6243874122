"""The report of ``smsid identify`` for a welded arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.arm.comparison import JudgedArm
from smsid.arm.units import joint_unit
from smsid.errors import SmsidError
from smsid.identify.estimate_text import asked_for
from smsid.recording import Recording
from smsid.report._residuals import trace_explorer
from smsid.report._spectra import spectrum_grid
from smsid.report._traces import Trace
from smsid.report.model import Provenance, Report, Section, Table, Tone, cells, notes_section
from smsid.report.numbers import share
from smsid.report.parameters import identifiability, parameter_table

NOTE = "A ratio of one: predicted as well as the recording it was identified from."
WELL = 0.1  # relative torque error on data not identified from, up to which the arm counts as explained


def arm_report(found: JudgedArm, recordings: Sequence[Recording], origin: Provenance) -> Report:
    """Return the report of an arm's identification; it is judged by ``recordings``, its own first."""
    own = asked_for(found.estimate)
    good = sum(p.status == "identifiable" for p in own)
    groups = {r.name: torque_traces(found, r) for r in recordings}
    judged = [(r, found.judge(r)) for r in recordings]
    held = [(r, e) for r, e in judged if r.role == "validation"]
    judge, errors = held[0] if held else judged[0]
    seen = "on held-out data" if held else "on the data it was identified from"
    sentence = (
        f"{good} of {len(own)} parameters are identified to better than 10 % (one standard deviation), and "
        f"the torques {seen} are predicted to {share(errors.relative, 3)} ({judge.name})."
    )
    tone: Tone = "neutral" if not held else "good" if errors.relative <= WELL else "warn"
    joints = tuple(errors.by_joint)
    table = Table(
        "Torques: |predicted − measured| / |measured|",
        ("recording", "role", "#all joints", *(f"#{j}" for j in joints)),
        [cells(r.name, r.role, (e.relative, 3), *((e.by_joint[j], 3) for j in joints)) for r, e in judged],
    )
    traces = [t for ts in groups.values() for t in ts]
    caption = "Below: measured minus predicted, beside twice its rms on the recording identified from."
    figure, torques = trace_explorer(traces, "Measured and predicted torque", caption,
                               band="± 2 rms of the fit", scale="rms of the fit", note=NOTE)  # fmt: skip
    spectra = spectrum_grid("spectrum", groups, labels=("", "residual torque"))
    parameters = (
        identifiability("known", own),
        parameter_table("Combinations of links, friction and motors", own),
    )
    sections = (
        Section("parameters", "Parameters", parameters, f"{len(own)} with intervals"),
        Section("residuals", "Measured against predicted", (table, figure, torques)),
        Section("spectra", "Spectra of the residuals", (spectra,)),
        *notes_section(found.estimate.notes),
    )
    glance = [("identifiable", f"{good} of {len(own)}")]
    glance += [(f"torque error, {r.role}", share(e.relative, 3)) for r, e in judged]
    name = found.model.description.name
    return Report("Identification of an arm", name, sentence, tone, sections, origin, glance[:4])


def torque_traces(found: JudgedArm, recording: Recording) -> tuple[Trace, ...]:
    """Return measured and predicted torque of every joint of a recording, averaged as for identification."""
    try:
        both = found.compare(recording)
    except SmsidError:
        return ()
    left = both.measured - both.predicted
    names = list(found.model.pin.names)[1:]
    # means over blocks have no white noise to compare with: the residual of the fit itself is the scale
    fitted = np.sqrt(np.mean(found.residual() ** 2, axis=0))
    out = []
    for k in range(left.shape[1]):
        if not both.measured[:, k].any() and not both.predicted[:, k].any():
            continue  # its torque signal is not used
        label, unit = f"{recording.name}: {names[k]}", joint_unit("N m", found.model, names[k])
        values = both.measured[:, k], both.predicted[:, k], left[:, k]
        out.append(Trace(label, unit, both.time, *values, float(fitted[k])))
    return tuple(out)
