"""Where a report is from: versions, command line, seed, and the sha256 sums of the files it was made from."""

from __future__ import annotations

import os
import platform
import shlex
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from smsid._files import sha256
from smsid._version import __version__
from smsid.report.model import Provenance

if TYPE_CHECKING:
    from smsid.description import Description

PACKAGES = {"pinocchio": "pin", "numpy": "numpy", "scipy": "scipy", "numba": "numba"}


def provenance(inputs: Iterable[str | os.PathLike[str]] = (), *, seed: object = None) -> Provenance:
    """Return how what is running now came to be; files that a description names are to be given too.

    The machine is told by system and processor, without its name.
    """
    versions = {"smsid": __version__, "python": platform.python_version()}
    for name, package in PACKAGES.items():
        try:
            versions[name] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return Provenance(
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        command=" ".join([Path(sys.argv[0]).name, *(shlex.quote(a) for a in sys.argv[1:])]),
        versions=versions,
        machine=f"{platform.system()} {platform.machine()}",
        inputs={p: sha256(p) if Path(p).is_file() else "not a file" for p in dict.fromkeys(map(str, inputs))},
        seed="" if seed is None else str(seed),
    )


def files_of(description: Description, path: str | os.PathLike[str]) -> list[str]:
    """Return the files a description is made of: its own, and the URDFs it names."""
    named = [description.urdf, *(a.urdf for a in description.arm if a.urdf)]
    found = [str(Path(description.folder, n)) for n in named if Path(description.folder, n).is_file()]
    return [str(path), *found]
