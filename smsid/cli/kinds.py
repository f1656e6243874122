"""Arguments in each other's places: what a file is, by its suffix, against what is asked for."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from smsid.cli.places import is_argument, option_name
from smsid.errors import SmsidError

LOG = "a log"
KINDS = {
    ".nc": "a recording",
    ".toml": "a TOML (description, experiment or mapping)",
    ".urdf": "a URDF",
    ".xacro": "a xacro",
    ".sdf": "an SDF",
    ".mjcf": "an MJCF",
    ".xml": "an MJCF",
    ".json": "a JSON (estimate, diagnosis or controller)",
    ".jsonl": "the store of a campaign",
    ".csv": LOG,
    ".npz": LOG,
    ".mat": LOG,
    ".bag": LOG,
    ".mcap": LOG,
    ".ulg": LOG,
    ".parquet": LOG,
}
"""What a file is by its suffix."""

ROBOTS = (".toml", ".urdf", ".xacro", ".sdf", ".mjcf", ".xml")
WANTED = {
    "description": ("description (TOML or URDF)", ROBOTS),
    "experiment": ("experiment (TOML or a name)", (".toml",)),
    "recordings": ("recordings (.nc)", (".nc", ".h5", ".hdf5")),
    "recording": ("recording (.nc)", (".nc", ".h5", ".hdf5")),
    "validate": ("recordings (.nc)", (".nc", ".h5", ".hdf5")),
    "estimate": ("estimate (JSON)", (".json",)),
    "second": ("estimate (JSON)", (".json",)),
    "truth": ("estimate (JSON)", (".json",)),
    "mapping": ("mapping (TOML)", (".toml",)),
    "plan": ("plan (TOML)", (".toml",)),
    "arm": ("description (TOML or URDF)", ROBOTS),
}
"""What a parameter takes by its name, and the suffixes that fit."""

ORDINALS = ("first", "second", "third")


def check_kinds(function: Callable[..., Any], options: Mapping[str, Any]) -> None:
    """Raise `SmsidError` where a file is given in the place of another kind, and say which goes where."""
    parameters = inspect.signature(function, eval_str=True).parameters
    order = [name for name, p in parameters.items() if is_argument(p)]
    # a robot by its name stands in the description's place: the first argument is a recording then
    wants = WANTED | {"description": WANTED["recordings"]} if options.get("robot") else WANTED
    for name, value in options.items():
        if name not in wants:
            continue
        wanted, fitting = wants[name]
        for path in value if isinstance(value, list | tuple) else [value]:
            suffix = Path(path).suffix.lower() if isinstance(path, str | Path) else ""
            if suffix not in KINDS or suffix in fitting:
                continue
            if name in order:
                verb = "come" if "recordings" in wanted else "comes"
                place = f"the {wanted} {verb} {ORDINALS[order.index(name)]}"
                usage = " ".join(n.upper() for n in order)
            else:
                place = f"{option_name(parameters[name])} takes the {wanted}"
                usage = f"{option_name(parameters[name])} {Path('FILE').with_suffix(fitting[0])}"
            advice = f"Give {usage}."
            if KINDS[suffix] == LOG and "recording" in wanted:
                advice = "Turn it into a recording with `smsid import` first."
            raise SmsidError(f"'{path}' is {KINDS[suffix]}; {place}.", advice=advice, path=str(path))
