"""The package as a whole: light imports, complete docstrings, no unknown keyword swallowed."""

from __future__ import annotations

import importlib
import inspect
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import smsid

MODULES = sorted(m.name for m in pkgutil.walk_packages(smsid.__path__, "smsid."))


def test_importing_smsid_pulls_in_no_plotting_and_no_server() -> None:
    heavy = ("matplotlib", "meshcat", "tornado", "plotly", "zmq")
    code = f"import sys, smsid; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ
    )
    assert done.stdout.strip() == "[]"


def test_importing_everything_but_the_view_needs_no_view() -> None:
    names = [m for m in MODULES if ".view" not in m]
    code = (
        "import sys, importlib\n"
        "sys.modules['meshcat'] = None\n"
        f"for name in {names!r}: importlib.import_module(name)\n"
        "print('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("name", MODULES)
def test_public_things_have_docstrings_and_swallow_no_keywords(name: str) -> None:
    module = importlib.import_module(name)
    assert module.__doc__, f"{name} has no docstring"
    for label, thing in vars(module).items():
        if label.startswith("_") or getattr(thing, "__module__", None) != name:
            continue
        if inspect.isfunction(thing):
            assert thing.__doc__, f"{name}.{label} has no docstring"
            kinds = [p.kind for p in inspect.signature(thing).parameters.values()]
            swallows = inspect.Parameter.VAR_KEYWORD in kinds
            assert not swallows or label == "physical", f"{name}.{label} takes **kwargs"
        elif inspect.isclass(thing):
            assert thing.__doc__, f"{name}.{label} has no docstring"


def test_the_citation_has_the_version_of_the_package():
    text = (Path(smsid.__file__).parents[1] / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {smsid.__version__}\n" in text


def test_the_version_is_an_option_too(capsys, monkeypatch):
    from smsid.cli.app import main

    monkeypatch.setattr("sys.argv", ["smsid", "--version"])
    main()
    assert capsys.readouterr().out.strip() == smsid.__version__


def test_it_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "smsid", "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.strip() == smsid.__version__
