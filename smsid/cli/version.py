"""``smsid version``."""

from __future__ import annotations

from smsid._version import __version__
from smsid.cli.errors import Outcome


def version_command() -> Outcome:
    """Print the version."""
    print(__version__)
    return Outcome({"version": __version__})
