"""The story of a diagnosis: what the simulation gets wrong, before and after, where it can be seen."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

from smsid.diagnose.validation import Gain
from smsid.errors import SmsidError
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem
from smsid.recording import Recording
from smsid.report.model import Part, Section, Text
from smsid.report.numbers import number, share
from smsid.report.open_loop import OpenLoop, curves, error_table, most_different, open_loop

LOGGER = logging.getLogger(__name__)
COLOURS = (1, 4, 0)


def story_section(
    models: Mapping[str, Point],
    like: Problem,
    recording: Recording,
    *,
    seen: bool,
    rate: float,
    gain: Gain | None = None,
) -> tuple[Section, OpenLoop | None]:
    """Return measured against simulated before and after, with the errors, and what it was made from.

    Args:
        models: by what they are called, from the one as given to the extended one; two or three.
        like: the problem whose noise levels and timing hold.
        recording: what is simulated; ``seen``: whether the diagnosis was made from it.
        rate: most samples a second [Hz].
        gain: of the extension on this recording, where it was evaluated.
    """
    title = "Measured against simulated, before and after"
    kind = "the recording that was diagnosed" if seen else "a recording not used for estimation or diagnosis"
    try:
        found = open_loop(models, like, recording, rate)
    except SmsidError as error:
        LOGGER.info("open loop: %s", error)
        return Section("story", title, (Text((f"Not evaluated: {error}",)),), kind), None
    before, after = next(iter(models)), list(models)[-1]
    parts: list[Part] = []
    if before in found.models and after in found.models:
        palette = dict(zip(models, COLOURS if len(models) == 3 else (COLOURS[0], COLOURS[-1]), strict=True))
        heading = f"'{recording.name}': {kind}"
        if shown := most_different(found, before, after):
            parts.append(curves(found, shown, "before-after", heading, palette))
        else:
            parts.append(Text(("In no channel do the models differ by more than three times its noise.",)))
    parts.append(error_table(found, before, after))
    if gain is not None and math.isfinite(gain.explained):
        parts.insert(1, Text((gain_sentence(gain),)))
    return Section("story", title, parts, kind), found


def gain_sentence(g: Gain) -> str:
    """Return what an extension gains on a recording not used, in one sentence."""
    return (
        f"On '{g.recording}', which was not used, predictions one sample ahead are off by "
        f"{number(g.whitened_given, 3)} times the noise with the model as given, by "
        f"{number(g.whitened_nominal, 3)} "
        f"with its parameters refitted and nothing added, and by {number(g.whitened_extended, 3)} "
        "with the cause: "
        f"{share(g.explained, 4)} of what exceeds the noise is gone."
    )
