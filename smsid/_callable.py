"""Subpackages that can be called: ``smsid.identify(...)`` beside ``smsid.identify.estimate``."""

from __future__ import annotations

import importlib
import inspect
import sys
from types import ModuleType
from typing import Any


class _CallableModule(ModuleType):
    """A module whose call is a function of `smsid.api` of the same name, loaded when it is called."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return _function(self)(*arguments, **options)

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(_function(self))


def _function(module: ModuleType) -> Any:
    return getattr(importlib.import_module("smsid.api"), module.__name__.rpartition(".")[2])


def make_callable(name: str) -> None:
    """Let the module of a name be called as the function of `smsid.api` that has its last name."""
    sys.modules[name].__class__ = _CallableModule
