"""Arguments of xacro files that are given beside a description, as on the command line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

_given: ContextVar[Mapping[str, str]] = ContextVar("xacro_arguments")


@contextmanager
def xacro_arguments(arguments: Mapping[str, str]) -> Iterator[None]:
    """Let every description that is loaded meanwhile hand these arguments to its xacro files."""
    token = _given.set(dict(arguments))
    try:
        yield
    finally:
        _given.reset(token)


def given_arguments() -> dict[str, str]:
    """Return the arguments of the innermost `xacro_arguments`."""
    return dict(_given.get({}))
