"""Sensor presets: rate and errors of real instruments, with their sources."""

from __future__ import annotations

import copy
import difflib
import tomllib
from functools import cache
from importlib import resources
from typing import Any

from smsid.errors import DescriptionError


@cache
def _table() -> dict[tuple[str, str], dict[str, Any]]:
    text = resources.files("smsid.sensing").joinpath("presets.toml").read_text(encoding="utf-8")
    return {(p["name"], p["kind"]): p for p in tomllib.loads(text)["preset"]}


def preset_names(kind: str | None = None) -> tuple[str, ...]:
    """Return the names of the presets, of one ``kind`` of sensor or all of them, sorted."""
    return tuple(sorted({name for name, of in _table() if kind is None or of == kind}))


def preset(name: str, kind: str | None = None) -> dict[str, Any]:
    """Return the fields a preset gives a `Sensor`: ``kind``, ``rate``, ``errors``, perhaps ``quantities``.

    ``Sensor(name="imu", kind="imu", preset="stim300")`` is the usual way; this is for reading the numbers.

    Args:
        name: one of `preset_names`.
        kind: kind of the sensor; needed for a preset that covers several (``reference``).

    Raises:
        DescriptionError: no such preset (evidence: the closest names), or ``kind`` is missing or wrong.
    """
    entry = dict(_entry(name, kind))
    del entry["name"], entry["source"]
    return copy.deepcopy(entry)


def preset_source(name: str, kind: str | None = None) -> str:
    """Return where the numbers of a preset come from: what was seen, what is typical, what is assumed.

    Args:
        name: one of `preset_names`.
        kind: kind of the sensor; needed for a preset that covers several.

    Raises:
        DescriptionError: as `preset`.
    """
    return str(_entry(name, kind)["source"])


def _entry(name: str, kind: str | None) -> dict[str, Any]:
    table = _table()
    kinds = [of for known, of in table if known == name]
    if not kinds:
        closest = difflib.get_close_matches(name, preset_names(), n=3, cutoff=0.4)
        raise DescriptionError(
            f"There is no sensor preset '{name}'.",
            advice=f"Closest: {', '.join(closest)}." if closest else f"Known: {', '.join(preset_names())}.",
            name=name,
            closest=closest,
            known=preset_names(),
        )
    if kind is None and len(kinds) == 1:
        return table[name, kinds[0]]
    if kind not in kinds:
        raise DescriptionError(
            f"The sensor preset '{name}' is for {', '.join(kinds)}"
            + (f", not {kind}." if kind is not None else "; kind is not given."),
            advice="Give the sensor one of these kinds"
            + (f", or one of the presets for {kind}: {', '.join(preset_names(kind))}." if kind else "."),
            name=name,
            kind=kind,
            kinds=kinds,
        )
    return table[name, kind]
