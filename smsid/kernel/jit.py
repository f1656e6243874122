"""Compilation by numba, and its cache on disk."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

try:
    numba: Any = import_module("numba")
except ImportError:
    numba = None

logger = logging.getLogger(__name__)

SWITCH = "SMSID_COMPILED"  # environment variable; "0" asks for the plain way, "1" to compile at once
# not-a-number and infinity keep their meaning
OPTIONS = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}
_reasons: list[str] = [] if numba else ["numba is not installed (pip install 'smsid[fast]')"]


def compile_inner(function: Callable[..., Any]) -> Any:
    """Compile a function that other compiled ones call."""
    return function if numba is None else numba.njit(function, **OPTIONS)


def compiled_and_cached(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, or take it from the disk.

    numba would ask whether the file of the function has changed, and not whether those of what it calls
    have: what it finds is read only where the text of this whole folder is the same.
    """
    if numba is None:
        return function
    try:
        found = numba.njit(function, cache=True, **OPTIONS)
        kept = found._cache
        # as a version, for numba looks at it before it unpickles what may name classes that are gone
        kept._cache_file._version = f"{numba.__version__} {_digest()}"
        kept.load_overload = _without_cache_errors(partial(_load_compiled, kept), kept.flush)
        kept.save_overload = _without_cache_errors(kept.save_overload)
    except (RuntimeError, AttributeError, OSError) as error:
        _reasons.append(f"numba keeps no cache ({error}); NUMBA_CACHE_DIR may name a folder for it")
        return function
    return found


def _load_compiled(kept: Any, signature: Any, target: Any) -> Any:
    """Load compiled code with the runtime it needs, and not with all that numba needs to compile: 0.2 s.

    As numba's own `load_overload`, which refreshes ``target`` first. Who compiles does that anyway.
    """
    runtime = import_module("numba.core.runtime").rtsys
    runtime.initialize(target)
    with kept._guard_against_spurious_io_errors():
        return kept._load_overload(signature, target)
    return None


def _without_cache_errors(
    act: Callable[..., Any], afterwards: Callable[[], None] = lambda: None
) -> Callable[..., Any]:
    """Return a function that loads or saves, or says why it could not: nothing is lost without a cache."""

    def attempt(*given: Any) -> Any:
        try:
            return act(*given)
        except Exception as error:  # of a damaged file pickle raises anything
            logger.warning("the cache of what numba has compiled cannot be used: %s", error)
            with suppress(OSError):
                afterwards()
        return None

    return attempt


@cache
def _digest() -> str:
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def compiled_already(function: Any) -> bool:
    """Return whether a function of `compiled_and_cached` is compiled, in this process or on the disk."""
    return bool(getattr(function, "overloads", None)) or _on_disk(function)


@cache
def _on_disk(function: Any) -> bool:
    try:
        return bool(function._cache._cache_file._load_index())
    except Exception:  # there is no cache, or a damaged one, of which pickle raises anything
        return False


def available() -> bool:
    """Return whether compiled code can be used; where it cannot, the log says why, once."""
    return os.environ.get(SWITCH, "1") != "0" and _complete()


@cache
def _complete() -> bool:
    if _reasons:
        logger.warning("simulations go the plain way, which is slower: %s", _reasons[0])
    return not _reasons
