"""The references of effects, of sensors' errors and of channels in docs, written from the code."""

from __future__ import annotations

import os
import re
from collections.abc import Container, Iterator
from pathlib import Path

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from smsid._files import atomic_write
from smsid.effects.appendage import ModalAppendage, Mode
from smsid.effects.base import Effect, catalogue
from smsid.recording.channels import QUANTITIES
from smsid.sensing import ErrorModel

BEGIN, END = "<!-- effects: begin -->", "<!-- effects: end -->"
ERRORS = "<!-- errors: begin -->", "<!-- errors: end -->"
SHARED = "<!-- shared: begin -->", "<!-- shared: end -->"
CHANNELS = "<!-- channels: begin -->", "<!-- channels: end -->"

KNOWN, NOISE = "taken into account as known", "as noise"
DRAWN = "one more unknown of each recording, with this standard deviation"
USE = {
    "noise_density": NOISE,
    "noise_sigma": NOISE,
    "bias": KNOWN,
    "bias_sigma": DRAWN,
    "bias_instability": "a state of the filter about an unknown bias; where it is fast, noise",
    "bias_correlation_time": "with `bias_instability`",
    "random_walk": "a state of the filter",
    "scale_error": KNOWN,
    "scale_slope": KNOWN,
    "scale_sigma": DRAWN,
    "misalignment": KNOWN,
    "misalignment_sigma": DRAWN,
    "quantisation": NOISE,
    "saturation": "readings at it are left out",
    "delay": KNOWN,
    "time_offset": KNOWN,
    "bias_from": KNOWN,
    "outlier_rate": NOISE,
    "outlier_size": NOISE,
    "stuck_from": "readings from then on are left out",
    "components": "as the keys in it",
}
"""What the filter of identification, tracking and diagnosis makes of each key."""


def effects_reference() -> str:
    """Return Markdown with a section per kind of effect: every key with unit, default and meaning.

    Keys with a unit in the second column are physical parameters: they can be identified and given a prior.
    """
    lines: list[str] = []
    for kind, cls in sorted(catalogue().items()):
        lines += [f"## `{kind}`", "", f"{cls.summary[:1].upper()}{cls.summary[1:]}.", ""]
        lines += _table(cls, set(Effect.model_fields))
        if issubclass(cls, ModalAppendage):
            lines += ["Keys of `[[effect.mode]]`:", "", *_table(Mode)]
    return "\n".join(lines).rstrip() + "\n"


def shared_reference() -> str:
    """Return Markdown with a table of the keys that every kind of effect has."""
    return "\n".join(_table(Effect)).rstrip() + "\n"


def errors_reference() -> str:
    """Return Markdown with a table of every key of a sensor's errors: unit, meaning, and what uses it."""
    lines = ["| key | meaning | in `identify`, `track` and `diagnose` |", "|---|---|---|"]
    text = (ErrorModel.__doc__ or "").split("Attributes:\n")[1].split("\n\n")[0]
    said = dict(re.findall(r"^ {8}(\w+): (.*?)(?=^ {8}\w|\Z)", text + "\n", re.MULTILINE | re.DOTALL))
    for name in ErrorModel.model_fields:
        meaning = " ".join(said[name].split()).replace("``", "`")
        lines.append(f"| `{name}` | {meaning.removesuffix(' See below.')} | {USE[name]} |")
    return "\n".join(lines) + "\n"


def channels_reference() -> str:
    """Return Markdown with a table of every quantity a channel may have: unit, frame, shape and meaning."""
    lines = ["| quantity | what it is | unit | frame | shape |", "|---|---|---|---|---|"]
    for q in QUANTITIES.values():
        lines.append(f"| `{q.name}` | {q.meaning} | {q.unit} | {q.frame} | {q.shapes()} |")
    return "\n".join(lines) + "\n"


def write_reference(path: str | os.PathLike[str]) -> None:
    """Put each reference between its two marks in a Markdown file, where it has them."""
    text = Path(path).read_text(encoding="utf-8")
    written = {(BEGIN, END): effects_reference, ERRORS: errors_reference, CHANNELS: channels_reference}
    written[SHARED] = shared_reference
    for (begin, end), reference in written.items():
        if begin in text:
            before, rest = text.split(begin)
            _, after = rest.split(end)
            text = f"{before}{begin}\n{reference()}{end}{after}"
    atomic_write(path, text)


def _table(model: type[BaseModel], told: Container[str] = ()) -> Iterator[str]:
    """Yield the table of a model's keys, but for those ``told`` elsewhere; nothing where none are left."""
    own = {n: info for n, info in model.model_fields.items() if n != "kind" and n not in told}
    if not own:
        return
    yield "| key | parameter in | default | meaning |"
    yield "|---|---|---|---|"
    for name, info in own.items():
        extra = info.json_schema_extra
        unit = extra.get("unit", "") if isinstance(extra, dict) else ""
        yield f"| `{name}` | {unit} | {_default(info)} | {info.description or ''} |"
    yield ""


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    value = info.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined or value in ((), {}):
        return ""
    return f"`{list(value) if isinstance(value, tuple) else value}`"


if __name__ == "__main__":
    for page in ("description", "effects", "design"):
        write_reference(Path(__file__).resolve().parents[2] / "docs" / f"{page}.md")
