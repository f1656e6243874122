"""Loading and saving a description."""

from __future__ import annotations

import difflib
import os
import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import BaseModel, ValidationError

from smsid._files import atomic_write
from smsid.description.schema import Description
from smsid.errors import DescriptionError, SmsidError


def read_toml(path: Path, error: type[SmsidError] = DescriptionError) -> dict[str, Any]:
    """Return the tables of a TOML file; raises ``error`` naming the file and the line."""
    if not path.is_file():
        raise error(f"The file '{path}' does not exist.", advice="Check the path.")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as cause:
        raise error(f"'{path}' is not valid TOML: {cause}.", advice="Mend the place it names.") from cause


def explain_validation(cause: ValidationError, path: Path | str, error: type[SmsidError]) -> SmsidError:
    """Turn pydantic's report into one smsid error that names key, place and mend."""
    lines = []
    for item in cause.errors():
        place = ".".join(str(part) for part in item["loc"]) or "the file"
        message = item["msg"].removeprefix("Value error, ")
        if item["type"] == "extra_forbidden":
            message = "unknown key" + _nearest(cause.title, str(item["loc"][-1]))
        lines.append(f"{place}: {message}")
    return error(
        f"'{path}' is not as the schema wants it: " + "; ".join(lines) + ".",
        advice="See docs/description.md for every key.",
        problems=lines,
    )


def load_description(path: str | os.PathLike[str]) -> Description:
    """Load a spacecraft from its TOML; relative paths in it start at the TOML's folder.

    Raises `DescriptionError` for a missing file, bad TOML, or anything against the schema.
    """
    file = Path(path)
    if file.suffix == ".urdf":
        return Description(name=file.stem, urdf=file.name, folder=file.parent)
    tables = read_toml(file)
    try:
        return Description.model_validate({**tables, "folder": file.parent})
    except ValidationError as cause:
        raise explain_validation(cause, file, DescriptionError) from cause


def save_description(description: Description, path: str | os.PathLike[str]) -> None:
    """Write the TOML whole or not at all; relative paths are rewritten to the new folder."""
    file = Path(path)
    tables = description.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_defaults=False)
    tables = _without_empty(tables)
    tables["urdf"] = _relative(description.folder / description.urdf, file.parent)
    if description.package_dirs:
        tables["package_dirs"] = [_relative(description.folder / d, file.parent) for d in description.package_dirs]
    for table, arm in zip(tables.get("arm", []), description.arm, strict=True):
        if arm.urdf is not None:
            table["urdf"] = _relative(description.folder / arm.urdf, file.parent)
    atomic_write(file, tomli_w.dumps(tables))


def _relative(target: Path, start: Path) -> str:
    return os.path.relpath(target.resolve(), start.resolve())


def _without_empty(tables: Any) -> Any:
    if isinstance(tables, dict):
        return {k: _without_empty(v) for k, v in tables.items() if v not in ({}, [])}
    if isinstance(tables, list):
        return [_without_empty(v) for v in tables]
    return tables


def _nearest(title: str, key: str) -> str:
    known: set[str] = set()

    def collect(model: type[BaseModel]) -> None:
        for sub in model.__subclasses__():
            known.update(sub.model_fields)
            collect(sub)

    collect(BaseModel)
    near = difflib.get_close_matches(key, known, n=1)
    return f" (did you mean '{near[0]}'?)" if near else ""
