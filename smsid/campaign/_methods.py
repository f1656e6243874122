"""Methods by name: functions that take a `Case` and return its `Findings`."""

from __future__ import annotations

import importlib
import inspect
import logging
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast, get_type_hints

from pydantic import TypeAdapter, ValidationError

from smsid._listing import did_you_mean
from smsid.campaign.outcome import Findings
from smsid.errors import ExperimentError

logger = logging.getLogger(__name__)

Method = Callable[..., Findings]
"""Called as ``method(case, **options)`` with a `Case`; must be a pure function of ``case`` and options."""

# References, not functions: workers import what they need, and `import smsid.campaign` stays light.
METHODS = {name: f"smsid.campaign._identification:run_{name}" for name in ("ml", "paper")}


def reference_of(name: str) -> str:
    """Return ``module:function`` of a method; raises `ExperimentError` for an unknown name."""
    if ":" in name:
        return name
    if name not in METHODS:
        raise ExperimentError(
            f"There is no method '{name}'." + did_you_mean(name, list(METHODS)),
            advice=f"Known: {', '.join(METHODS)}; or give `module:function` of your own.",
        )
    return METHODS[name]


def import_method(reference: str, folder: Path) -> Method:
    """Import ``module:function``; modules in ``folder`` (the plan's) are found too.

    Raises `ExperimentError` when there is no such module or function.
    """
    module_name, _, function = reference.partition(":")
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    importlib.invalidate_caches()
    try:
        module = importlib.import_module(module_name)
    except Exception as cause:  # the module is the user's: anything may go wrong in it
        raise ExperimentError(
            f"The method '{reference}' cannot be imported: {type(cause).__name__}: {cause}.",
            advice="Its module must be installed, or be in the folder of the plan.",
        ) from cause
    method = getattr(module, function, None)
    if not callable(method):
        raise ExperimentError(
            f"Module '{module_name}' has no function '{function}'."
            + did_you_mean(function, [n for n, _ in inspect.getmembers(module, inspect.isfunction)])
        )
    return cast(Method, method)


def check_options(method: Method, name: str, options: Mapping[str, Any]) -> None:
    """Raise `ExperimentError` for options the method does not take or lacks, or of the wrong type."""
    signature = inspect.signature(method)
    try:
        signature.bind(None, **options)
    except TypeError as cause:
        known = ", ".join(list(signature.parameters)[1:])
        raise ExperimentError(
            f"The options do not fit the method '{name}': {cause}.", advice=f"Options: {known or 'none'}."
        ) from cause
    try:
        hints = get_type_hints(method)
    except Exception:  # annotations are the user's, and need not be importable
        logger.info("The annotations of '%s' cannot be read; its options are not checked by type.", name)
        return
    for key, value in options.items():
        try:
            TypeAdapter(hints.get(key, Any)).validate_python(value)
        except ValidationError as cause:
            reason = cause.errors()[0]["msg"]
            raise ExperimentError(f"Option `{key}` of the method '{name}' is {value!r}. {reason}.") from cause


def source_of(method: Method) -> bytes:
    """Return the source of the module that defines a method, empty when there is none to read."""
    try:
        file = inspect.getsourcefile(method)
    except TypeError:
        return b""
    return Path(file).read_bytes() if file and Path(file).is_file() else b""
