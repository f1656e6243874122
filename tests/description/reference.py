"""The reference of effects in docs/description.md, written from the catalogue."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from smsid._files import atomic_write
from smsid.effects.appendage import ModalAppendage, Mode
from smsid.effects.base import catalogue

BEGIN, END = "<!-- effects: begin -->", "<!-- effects: end -->"


def effects_reference() -> str:
    """Return Markdown with a section per kind of effect: every key with unit, default and meaning.

    Keys with a unit in the second column are physical parameters: they can be identified and given a prior.
    """
    lines: list[str] = []
    for kind, cls in sorted(catalogue().items()):
        lines += [f"### `{kind}`", "", f"{cls.summary[:1].upper()}{cls.summary[1:]}.", "", *_table(cls)]
        if issubclass(cls, ModalAppendage):
            lines += ["Keys of `[[effect.mode]]`:", "", *_table(Mode)]
    return "\n".join(lines).rstrip() + "\n"


def write_reference(path: str | os.PathLike[str]) -> None:
    """Put the reference between its two marks in a Markdown file."""
    text = Path(path).read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    atomic_write(path, f"{before}{BEGIN}\n{effects_reference()}{END}{after}")


def _table(model: type[BaseModel]) -> Iterator[str]:
    yield "| key | parameter in | default | meaning |"
    yield "|---|---|---|---|"
    for name, info in model.model_fields.items():
        if name == "kind":
            continue
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
    write_reference(Path(__file__).resolve().parents[2] / "docs" / "description.md")
