"""``smsid``: from a spacecraft's description and its recordings to an identified model."""

from __future__ import annotations

import atexit
import gc
import logging
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from smsid._version import __version__
from smsid._xacro_arguments import xacro_arguments
from smsid.cli.errors import INTERRUPTED, CommandResult, error_document, print_json, with_output_options
from smsid.cli.output import WIDTH, error_console, wrap_text
from smsid.errors import SmsidError


@dataclass(frozen=True)
class Entry:
    """Where a command lives, ``module:name`` of a function or `typer.Typer` in this package, and its help."""

    target: str
    help: str

    def load(self, name: str) -> Any:
        """Import the command and return it as click knows it, with the options every command has."""
        found = resolve_name(f"smsid.cli.{self.target}")
        if isinstance(found, typer.Typer):
            for info in found.registered_commands:
                if info.callback is not None and not hasattr(info.callback, "__wrapped__"):
                    info.callback = with_output_options(info.callback)
            return typer.main.get_command(found)
        alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
        alone.command(name=name)(with_output_options(found))
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


# a new command is a line here; the order is that of the help, the module is imported when the command runs
COMMANDS = {
    "demo": Entry("demo:demo_command", "The paper's experiments, identified, beside its tables."),
    "new": Entry("descriptions:new_command", "Write a first description of your own craft."),
    "check": Entry("descriptions:check_command", "Tell all that is wrong or doubtful in a description."),
    "simulate": Entry("simulate:simulate_command", "Fly an experiment in simulation and record it."),
    "import": Entry("logs:import_command", "Turn a log into a recording, by a mapping file."),
    "cut": Entry("logs:cut_command", "Cut a window or pieces without gaps out of a recording."),
    "resample": Entry("logs:resample_command", "Bring a recording to one even clock."),
    "convert": Entry("logs:convert_command", "Write a recording as CSV, Parquet or MCAP."),
    "inspect": Entry("logs:inspect_command", "Tell what is in a log; draft its mapping."),
    "identify": Entry("identify:identify_command", "Identify a spacecraft from recordings."),
    "track": Entry("track:track_command", "Follow a spacecraft's parameters through recordings."),
    "stream": Entry("stream:stream_command", "Follow telemetry as it comes, in JSON lines."),
    "play": Entry("stream:play_command", "Play a recording as JSON lines."),
    "diagnose": Entry("diagnose:diagnose_command", "Say what the simulation gets wrong, and why."),
    "compare": Entry("compare:compare_command", "Tell what changed between two estimates."),
    "design": Entry("design:design_command", "Design the experiment whose data tell most."),
    "control": Entry("control:control_command", "Design a controller from what is identified."),
    "campaign": Entry("campaign:campaign_command", "Run a Monte Carlo campaign."),
    "regressor": Entry("descriptions:regressor_command", "Check regressors; name base parameters."),
    "export": Entry("export:export_command", "Export URDF, TOML, CSV, MuJoCo XML, a linear plant, an FMU."),
    "lab": Entry("lab:lab_app", "Tests in the laboratory: tank, structure, oscillator."),
    "show": Entry("show:show_command", "Show what is in a file."),
    "view": Entry("view:view_command", "Show a spacecraft or replay recordings in 3-D."),
    "plot": Entry("plot:plot_command", "Draw a figure for a paper: PNG, SVG or PDF."),
    "version": Entry("app:version_command", "Print the version."),
}

app = typer.Typer(
    name="smsid",
    cls=lazy_group(COMMANDS),
    help="Identify the dynamics of space manipulator systems from measured data.\n\n"
    "A spacecraft is a URDF and a TOML beside it (DESC.toml). Start with `smsid demo`; then\n"
    "`smsid simulate` or `smsid import` to get recordings, `smsid identify` to identify the spacecraft from\n"
    "them, `smsid show` and `smsid view` to look at anything.\n\n"
    "Robots are URDF, xacro (its arguments as NAME:=VALUE), SDF or MJCF.\n\n"
    "Every command takes --json (the result on stdout, nothing else) and --quiet.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _name, _entry in COMMANDS.items():
    app.command(name=_name, help=_entry.help)(lambda: None)  # a placeholder, never run
ARGUMENT = re.compile(r"[A-Za-z_][\w.-]*:=")
"""An argument of a xacro, ``name:=value`` as in ROS; every command that reads a robot takes them."""


def version_command() -> CommandResult:
    """Print the version."""
    print(__version__)
    return CommandResult({"version": __version__})


def _version(asked: bool) -> None:
    if asked:
        version_command()
        raise typer.Exit


class _WrappedText(logging.Formatter):
    """Lines of at most `WIDTH` characters, broken between words."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        return wrap_text(super().formatMessage(record), WIDTH)


@app.callback()
def _common(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="log what the library does")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    own = logging.StreamHandler()
    own.setFormatter(_WrappedText("%(levelname)s %(name)s: %(message)s"))
    told: dict[str, object] = {}  # once each: a command may load the same file several times
    own.addFilter(lambda record: told.setdefault(record.getMessage(), record) is record)
    logging.basicConfig(handlers=[own])  # unless there are some
    for handler in logging.getLogger().handlers:
        handler.setLevel(logging.INFO if verbose else logging.WARNING)
    logging.getLogger().setLevel(logging.INFO if verbose else logging.WARNING)


def main() -> None:
    """Run the command line; errors are told in one line, without a traceback.

    Exit codes: 0 done, 1 an error whose message says how to mend it, 2 wrong usage, 3 and 4 the verdicts
    unexplained and not evaluated of a diagnosis, 70 a fault of smsid itself (with its traceback), 130
    interrupted.
    """
    given = [a for a in sys.argv[1:] if ARGUMENT.match(a)]
    # a full collection looks at all that was imported: seldom, it finds little
    gc.set_threshold(*gc.get_threshold()[:2], 100)
    # nor does the one that ends the process, a quarter of a second after numba has been imported
    atexit.register(gc.freeze)
    try:
        with xacro_arguments(dict(a.split(":=", 1) for a in given)):
            rest = [a for a in sys.argv[1:] if a not in given]
            code = app(rest, standalone_mode=False, prog_name="smsid")
    except SmsidError as error:  # with --json it has been printed by the command
        _tell(f"error: {error}")
        code = 1
    except OSError as error:
        _tell(f"error: {error.strerror or error}: {error.filename}. Check the path, its rights and the disk.")
        _tell_json(error, 1)
        code = 1
    except (typer.Abort, KeyboardInterrupt):
        code = INTERRUPTED
    except Exception as error:
        if not hasattr(error, "format_message"):
            _tell("error: this is a fault of smsid, not of your input. Please report what follows.")
            import traceback

            traceback.print_exc()
            _tell_json(error, 70)
            sys.exit(70)
        # click's usage errors; those of a choice quote pydantic
        text = error.format_message().replace("Value error, ", "")  # type: ignore[attr-defined]
        if type(error).__name__ == "NoArgsIsHelpError":
            print(text, file=sys.stderr)
        else:
            context = getattr(error, "ctx", None)
            path = context.command_path if context is not None else "smsid"
            _tell(f"error: {text} See `{path} --help`.")
        _tell_json(error, 2)
        code = 2
    if code == INTERRUPTED:
        _tell("interrupted; files appear whole or not at all")
    if isinstance(code, int) and code:
        sys.exit(code)


def _tell(text: str) -> None:
    error_console().print(text, style="red", markup=False, highlight=False, soft_wrap=True)


def _tell_json(error: Exception, exit_code: int) -> None:
    if "--json" in sys.argv[1:]:
        print_json(error_document(error, exit_code))
