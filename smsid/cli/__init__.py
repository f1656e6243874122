"""The command line."""

from smsid.cli.app import main

__all__ = ["main"]
