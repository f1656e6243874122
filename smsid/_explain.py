"""Turning pydantic's report into one error that names key, place and mend in the words of the TOML."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from smsid.errors import SmsidError

M = TypeVar("M", bound=BaseModel)

TOML_KINDS = (
    ("experiment", ("duration",)),
    ("mapping", ("channel", "clock")),
    ("campaign_plan", ("runs",)),
    ("description", ("urdf",)),
)
"""Kinds of TOML, each with the keys of which only it has one; the first that fits."""


def toml_kind(tables: Mapping[str, Any]) -> str | None:
    """Return the kind of the tables of a TOML; ``None`` where they do not say."""
    return next((kind for kind, keys in TOML_KINDS if any(k in tables for k in keys)), None)


def validate_tables(
    model: type[M],
    tables: Mapping[str, Any],
    where: str,
    error: type[SmsidError],
    *,
    advice: str = "",
    folder: Path | None = None,
    kind: str = "",
) -> M:
    """Return the tables of a TOML as what they describe; ``folder`` is where relative paths in it start,
    ``kind`` the kind of file that it should be (`toml_kind`).

    An unknown key gets the closest key of the very table it stands in.

    Raises:
        SmsidError: of the kind ``error``, that says what pydantic found wrong in ``where``; the problems are
            also in ``evidence["problems"]``, one sentence each.
    """
    if folder is not None and "folder" in tables:
        raise error(
            f"{where} has the unknown key 'folder'.",
            advice="Paths start at the folder of the file; remove it.",
        )
    try:
        return model.model_validate(tables if folder is None else {**tables, "folder": folder})
    except ValidationError as cause:
        other = toml_kind(tables)
        if kind and other not in (kind, None) and not set(dict(TOML_KINDS)[kind]) & set(tables):
            told, wanted = (k.replace("_", " ") for k in (str(other), kind))
            raise error(
                f"{where} is of the kind '{told}', no {wanted}.",
                advice=f"Give the TOML of the {wanted} in its place.",
            ) from cause
        problems = _problems(cause, model, tables)
        raise error(
            f"{where} is not as the schema wants it: " + "; ".join(problems) + ".",
            advice=advice,
            problems=problems,
        ) from cause


def _problems(cause: ValidationError, model: type[BaseModel], tables: Mapping[str, Any]) -> list[str]:
    problems = []
    for item in cause.errors():
        place, known, is_table = _locate(item["loc"], model, tables)
        message = item["msg"].removeprefix("Value error, ").rstrip(".")
        given = item.get("input")
        if item["type"] == "extra_forbidden":
            message = "unknown key" + _nearest(str(item["loc"][-1]), known)
        elif item["type"] == "missing":
            message = "this key is missing"
        elif item["type"] == "tuple_type" and is_table and isinstance(given, Mapping):
            key = item["loc"][-1]
            message = f"write it as a list of tables, [[{key}]] with two brackets"
        elif isinstance(given, str | int | float | bool) and item["type"] != "smsid":
            message = f"{message}, not {given!r}"
        problems.append(f"{place}: {message}")
    return problems


def _locate(loc: Sequence[int | str], root: type[BaseModel], tables: Any) -> tuple[str, list[str], bool]:
    """Return a place's name, the keys of the table it stands in, and whether the place is a list of
    tables."""
    words: list[str] = []
    model: type[BaseModel] | None = root
    here, annotation = tables, None
    for depth, part in enumerate(loc):
        last = depth == len(loc) - 1
        here = _step(here, part)
        if isinstance(part, int):
            words[-1:] = [_entry_label(words[-1] if words else "item", part, here)]
            model = _table_model(annotation, here) or model
            continue
        field = _field_type(model, part)
        if field is None and annotation is not None and get_origin(annotation) is not dict and not last:
            continue  # the tag of a union's branch: no key of the file
        words.append(part)
        if last:
            inner = _table_model(field, None) if field is not None else None
            return ", ".join(words), _keys(model), inner is not None
        annotation = field if field is not None else annotation
        model = _table_model(annotation, here) or model
    return ", ".join(words) or "the file", _keys(model), False


def _entry_label(word: str, index: int, here: Any) -> str:
    name = here.get("name") if isinstance(here, Mapping) else None
    text = f"{word} number {index + 1}"
    return f"{text} ('{name}')" if isinstance(name, str) else text


def _step(here: Any, part: int | str) -> Any:
    if isinstance(here, Mapping):
        return here.get(part)
    if isinstance(here, list | tuple) and isinstance(part, int) and part < len(here):
        return here[part]
    return here


def _field_type(model: type[BaseModel] | None, key: str) -> Any:
    if model is None:
        return None
    for name, info in model.model_fields.items():
        if key in (name, info.alias):
            return info.annotation
    return None


def _table_model(annotation: Any, table: Any) -> type[BaseModel] | None:
    """Return the model behind an annotation; for an effect, the class of the table's kind."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if isinstance(table, Mapping) and "kind" in table:
            return _of_kind(annotation, table["kind"]) or annotation
        return annotation
    for inner in get_args(annotation):
        found = _table_model(inner, table)
        if found is not None:
            return found
    return None


def _keys(model: type[BaseModel] | None) -> list[str]:
    if model is None:
        return []
    return [info.alias or name for name, info in model.model_fields.items() if not info.exclude]


def _nearest(key: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1)
    if near:
        return f" (did you mean '{near[0]}'?)"
    return f" (known here: {', '.join(known)})" if known else ""


def _of_kind(model: type[BaseModel], kind: object) -> type[BaseModel] | None:
    for own in model.__subclasses__():
        if own.model_fields["kind"].default == kind:
            return own
        if deeper := _of_kind(own, kind):
            return deeper
    return None
