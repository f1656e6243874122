"""Names of a package that are loaded when they are used (PEP 562)."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from typing import Any

IMPORT = re.compile(r"^    from (\S+) import (?:\(([^)]*)\)|(.+))$", re.MULTILINE)


def lazy_names(package: str) -> tuple[dict[str, str], Callable[[str], Any]]:
    """Return the modules of a package's names, and its ``__getattr__``, which loads a name when it is asked.

    The names are what the package imports under ``if TYPE_CHECKING``, so they stand in its text once, where
    type checkers read them. None may be that of a module of the package.
    """
    spec = sys.modules[package].__spec__
    text = spec.loader.get_source(package) if spec and spec.loader else ""  # type: ignore[attr-defined]
    found = IMPORT.findall(text.partition("if TYPE_CHECKING:\n")[2])
    modules = {name: module for module, *names in found for name in re.findall(r"\w+", "".join(names))}

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = getattr(importlib.import_module(modules[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return modules, get
