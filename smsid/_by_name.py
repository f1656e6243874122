"""Results that are looked up by name: alike in ``[]``, ``in``, ``len``, ``for`` and ``dict``."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Generic, NoReturn, TypeVar

from smsid._listing import did_you_mean

T_co = TypeVar("T_co", covariant=True)


class ByName(Generic[T_co]):
    """What has parts with names, ``keys()``: ``for``, ``in``, ``len`` and ``dict`` go by them.

    As for a mapping, whatever is iterated over is in it and can be looked up; but a result without parts is a
    result, and true.
    """

    __slots__ = ()

    @abstractmethod
    def keys(self) -> tuple[str, ...]:
        """Return the names, in order."""

    @abstractmethod
    def __getitem__(self, name: str) -> T_co:
        """Give the part of a name."""

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

    def __bool__(self) -> bool:
        return True


def no_such_name(name: object, names: Sequence[str]) -> NoReturn:
    """Raise the `KeyError` of a name that is not there, with the nearest."""
    raise KeyError(f"{name}.{did_you_mean(str(name), names)}".removesuffix("."))
