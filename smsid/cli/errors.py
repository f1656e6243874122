"""``--json`` and ``--quiet`` for every command, and what a command hands back."""

from __future__ import annotations

import inspect
import io
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, redirect_stdout
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TextIO, get_type_hints

import typer

from smsid._files import json_ready, protect_inputs
from smsid.cli.output import OutputMode, output_options, say
from smsid.cli.places import check_kinds, check_numbers, check_places
from smsid.errors import SmsidError

AsJson = Annotated[bool, typer.Option("--json", help="print the result as JSON, and nothing else, on stdout")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="print nothing but errors")]
INTERRUPTED = 130  # exit code


@dataclass(frozen=True)
class CommandResult:
    """What a command found: a document for ``--json``, the files it wrote, and the exit code it ends with.

    The files are named on stdout after what the command printed, unless ``untold``.
    """

    document: Mapping[str, Any] = field(default_factory=dict)
    written: Sequence[Path | str] = ()
    exit_code: int = 0
    untold: bool = False


def with_output_options(function: Callable[..., Any]) -> Callable[..., None]:
    """Return a command with the options ``--json`` and ``--quiet``.

    ``function`` prints for people on stdout and returns a `CommandResult`; what it prints is left out where
    it was asked to be quiet. Of a function that returns nothing the text it prints stands in the JSON.
    """
    signature = inspect.signature(function, eval_str=True)
    own = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in (("as_json", AsJson), ("quiet", Quiet))
    ]
    own.append(inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context))

    @wraps(function)
    def run(*arguments: Any, as_json: bool, quiet: bool, context: typer.Context, **options: Any) -> None:
        given = signature.bind(*arguments, **options).arguments

        def command() -> Any:
            check_numbers(given)
            # those that nobody gave have their defaults
            sources = {name: context.get_parameter_source(name) for name in context.params}
            unnamed = [n for n, source in sources.items() if source is not None and source.name == "DEFAULT"]
            inputs = check_places(function, given, unnamed)
            check_kinds(function, given)
            with protect_inputs(inputs):
                return function(**given)

        _run(command, OutputMode(as_json, quiet))

    run.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *own])  # type: ignore[attr-defined]
    hints = get_type_hints(function, include_extras=True)
    run.__annotations__ = {**hints, **{p.name: p.annotation for p in own}}
    return run


def _run(command: Callable[[], Any], mode: OutputMode) -> None:
    stdout, hidden = sys.stdout, io.StringIO()
    hush = redirect_stdout(hidden) if mode.json or mode.quiet else nullcontext()
    try:
        with output_options(mode), hush:
            result = command()
            if isinstance(result, CommandResult) and result.written and not result.untold:
                say(f"wrote {', '.join(map(str, result.written))}")
    except typer.Exit as left:
        result = CommandResult(exit_code=left.exit_code)
    except SmsidError as error:
        if mode.json:
            print_json(error_document(error, 1), stdout)
        raise
    outcome = result if isinstance(result, CommandResult) else CommandResult()
    if mode.json:
        text = {} if isinstance(result, CommandResult) and result.document else {"text": hidden.getvalue()}
        written = [str(p) for p in outcome.written]
        print_json({"exit_code": outcome.exit_code, "written": written, **outcome.document, **text}, stdout)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)


def error_document(error: Exception, exit_code: int) -> dict[str, Any]:
    """Return what ``--json`` prints of an error: its kind, what is wrong and how to mend it."""
    message, advice = getattr(error, "message", str(error)), getattr(error, "advice", "")
    found = {"kind": type(error).__name__, "message": str(message), "advice": str(advice)}
    return {"exit_code": exit_code, "error": found}


def print_json(document: Mapping[str, Any], stream: TextIO | None = None) -> None:
    """Print a document as JSON; numbers that are not finite become null."""
    print(json.dumps(json_ready(dict(document)), indent=1, allow_nan=False, default=_json_value), file=stream)


def _json_value(x: Any) -> Any:
    """Return what stands for a value JSON does not know: numpy's numbers and arrays, paths."""
    return json_ready(x.tolist()) if hasattr(x, "tolist") else str(x)
