"""Loading and saving a description."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import BaseModel

from smsid._explain import validate_tables
from smsid._files import atomic_write, with_sum
from smsid._reading import read_toml
from smsid._xacro_arguments import given_arguments
from smsid.description._finite_elements import with_finite_elements
from smsid.description.robot_sources import SUFFIXES, is_xacro
from smsid.description.schema import Description
from smsid.description.urdf_check import read_urdf
from smsid.description.urdf_reading import parse_urdf
from smsid.errors import DescriptionError, SmsidError
from smsid.paths import bundled_craft, missing_craft_advice


def load_description(path: str | os.PathLike[str]) -> Description:
    """Load a spacecraft from its TOML, or straight from a URDF, xacro, SDF or MJCF.

    An arm's URDF alone, whose root has no mass, stands on the ground (`root = "fixed"`).
    Relative paths start at the file's folder. The name of a spacecraft that comes with smsid (``paper_sms``)
    does as well, where no file has it.

    Raises `DescriptionError` for a missing file, bad TOML, or anything against the schema; the URDFs
    themselves are read, and checked, by `smsid.model.build_model`.
    """
    file = Path(path)
    if not file.exists():
        file = bundled_craft(str(path)) or file
    if not file.is_file():
        raise DescriptionError(f"The file '{file}' does not exist.", advice=missing_craft_advice(str(path)))
    if file.suffix in SUFFIXES:
        name = file.stem.removesuffix(".urdf")
        bare = Description(name=name, urdf=file.name, folder=file.parent, meshes="optional")
        return _as_ground_machine(_with_arguments(bare))
    tables = with_finite_elements(read_toml(file, DescriptionError), file.parent)
    advice = "See docs/description.md for every key."
    found = validate_tables(
        Description,
        tables,
        f"'{file}'",
        DescriptionError,
        advice=advice,
        folder=file.parent,
        kind="description",
    )
    return _with_arguments(found)


def _as_ground_machine(bare: Description) -> Description:
    """Return a URDF alone as a machine on the ground where joints of an arm move on a root without mass.

    What cannot be read stays as it is: `smsid.model.build_model` says what is wrong.
    """
    path = bare.folder / bare.urdf
    try:
        found = parse_urdf(read_urdf(path, bare.arguments, [path.parent, bare.folder]), str(path))
    except SmsidError:
        return bare
    joints = found.joints.values()
    ground = {found.root}
    for _ in joints:
        ground |= {j.child for j in joints if j.kind == "fixed" and j.parent in ground}
    moving = [j.kind for j in joints if j.parent in ground and j.kind != "fixed"]
    heavy = any(found.links[name].mass > 0.0 for name in ground)
    if heavy or not moving or not set(moving) <= {"revolute", "continuous"}:
        return bare
    return bare.model_copy(update={"root": "fixed"})


def _with_arguments(d: Description) -> Description:
    """Return the description with the arguments of `xacro_arguments`, for every file that is a xacro.

    Raises `DescriptionError` if there are arguments, but no such file.
    """
    given = given_arguments()
    if not given:
        return d
    arms = tuple(
        a.model_copy(update={"arguments": {**a.arguments, **given}})
        if a.urdf is not None and is_xacro(d.folder / a.urdf)
        else a
        for a in d.arm
    )
    own = is_xacro(d.folder / d.urdf)
    if not own and arms == d.arm:
        raise DescriptionError(
            f"'{d.name}' has no xacro that could take {', '.join(f'{k}:={v}' for k, v in given.items())}.",
            advice="Leave the arguments out.",
        )
    return d.model_copy(update={"arm": arms, "arguments": {**d.arguments, **given} if own else d.arguments})


def save_description(description: Description, path: str | os.PathLike[str]) -> None:
    """Write the TOML whole or not at all; relative paths are rewritten to start at the new folder.

    Raises `SmsidError` when the folder does not exist.
    """
    file = Path(path)
    tables = _tables(description)
    tables["urdf"] = _relative(description.folder / description.urdf, file.parent)
    if description.package_dirs:
        tables["package_dirs"] = [
            _relative(description.folder / d, file.parent) for d in description.package_dirs
        ]
    for table, arm in zip(tables.get("arm", []), description.arm, strict=True):
        if arm.urdf is not None:
            table["urdf"] = _relative(description.folder / arm.urdf, file.parent)
    atomic_write(file, with_sum(tomli_w.dumps(tables)))


def _relative(target: Path, start: Path) -> str:
    return Path(os.path.relpath(target.resolve(), start.resolve())).as_posix()


def _tables(value: Any) -> Any:
    """Return a model as tables for TOML: by alias, without ``None`` and without empty defaults."""
    if isinstance(value, BaseModel):
        tables = {}
        for name, info in type(value).model_fields.items():
            item = getattr(value, name)
            empty = isinstance(item, dict | tuple | list) and not item
            unsaid = empty and item == info.get_default(call_default_factory=True)
            if item is None or info.exclude or unsaid:
                continue
            tables[info.alias or name] = _tables(item)
        return tables
    if isinstance(value, dict):
        return {key: _tables(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_tables(item) for item in value]
    return value
