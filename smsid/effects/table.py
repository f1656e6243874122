"""The base of everything a TOML table becomes: frozen, no unknown key, and numbers that are numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError


class StrictTable(BaseModel):
    """One table. Numbers must be finite; ``true`` and ``"5"`` are no numbers, which pydantic would take."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _numbers_are_numbers(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        error = PydanticCustomError("not_a_number", "Input should be a valid number")
        wrong: list[InitErrorDetails] = [
            {"type": error, "loc": (key, *path), "input": value}
            for key in numeric_keys(cls)
            if key in data
            for path, value in _find_wrong_types(data[key])
        ]
        if wrong:
            raise ValidationError.from_exception_data(cls.__name__, wrong)
        return data


@cache
def numeric_keys(model: type[BaseModel]) -> tuple[str, ...]:
    """Return the keys of a model that hold numbers, or lists or tables of numbers."""
    numeric = {float, int, NoneType}
    return tuple(
        info.alias or name
        for name, info in model.model_fields.items()
        if (kinds := set(_leaves(info.annotation))) <= numeric and kinds != {NoneType}
    )


def _leaves(annotation: Any) -> Iterator[Any]:
    args = [a for a in get_args(annotation) if a is not Ellipsis]
    if get_origin(annotation) is Annotated:
        args = args[:1]
    elif get_origin(annotation) is dict:
        args = args[1:]
    if not args:
        yield annotation
    for inner in args:
        yield from _leaves(inner)


def _find_wrong_types(value: Any) -> Iterator[tuple[tuple[int | str, ...], Any]]:
    """Yield the place and value of every string and truth value within."""
    if isinstance(value, bool | str):
        yield (), value
    elif isinstance(value, Mapping | list | tuple):
        for key, item in value.items() if isinstance(value, Mapping) else enumerate(value):
            for path, found in _find_wrong_types(item):
                yield (key, *path), found
