"""Commands that are imported when they are run, so that `smsid --help` does not wait for Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

from smsid.cli.errors import mannered


@dataclass(frozen=True)
class Entry:
    """Where a command lives, ``package.module:name`` of a function or `typer.Typer`, and its line of help."""

    target: str
    help: str

    def load(self, name: str) -> Any:
        """Import the command and return it as click knows it, with the options every command has."""
        module, _, attribute = self.target.partition(":")
        found = getattr(import_module(module), attribute)
        if isinstance(found, typer.Typer):
            for info in found.registered_commands:
                if info.callback is not None and not hasattr(info.callback, "__wrapped__"):
                    info.callback = mannered(info.callback)
            return typer.main.get_command(found)
        alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
        alone.command(name=name)(mannered(found))
        return typer.main.get_command(alone)


def lazy_group(commands: Mapping[str, Entry]) -> type[TyperGroup]:
    """Return the class of a group whose commands are placeholders until one of them is asked for."""

    class LazyGroup(TyperGroup):
        def resolve_command(self, ctx: Any, args: list[str]) -> Any:
            name, command, rest = super().resolve_command(ctx, args)
            if name is not None and name in commands:
                command = commands[name].load(name)
            return name, command, rest

    return LazyGroup


def register(app: typer.Typer, commands: Mapping[str, Entry]) -> None:
    """Put a placeholder for each command into an application whose class is `lazy_group`."""
    for name, entry in commands.items():
        app.command(name=name, help=entry.help)(lambda: None)  # never run
