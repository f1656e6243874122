"""``smsid version``."""

from __future__ import annotations

import smsid
from smsid.cli.manners import Outcome


def version_command() -> Outcome:
    """Print the version."""
    print(smsid.__version__)
    return Outcome({"version": smsid.__version__})
