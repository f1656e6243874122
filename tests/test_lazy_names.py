"""Packages whose names are loaded when they are used: all are there, and none hides behind a module."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys

import pytest


@pytest.mark.parametrize("package", ["smsid", "smsid.identify", "smsid.simulate"])
def test_every_name_is_there_whatever_was_imported_before(package: str):
    found = importlib.import_module(package)
    modules = {m.name for m in pkgutil.iter_modules(found.__path__)}
    called = {"simulate", "identify", "diagnose", "report", "view", "export"} if package == "smsid" else set()
    assert set(found.__all__) & modules <= called
    for name in found.__all__:
        assert getattr(found, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = found.nothing


def test_showing_an_estimate_needs_no_estimator():
    """It took four fifths of the time of `smsid show`."""
    code = "import sys, smsid.cli.show; print([m for m in ('scipy', 'pinocchio') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


def test_the_paper_s_experiments_are_identified_without_what_they_do_not_use():
    """`scipy.signal` and `scipy.stats` took a tenth of the command, the filter and the simulator as much."""
    heavy = (
        "scipy.signal",
        "scipy.stats",
        "scipy.integrate",
        "smsid.simulate.integrate",
        "smsid.kernel.filter",
    )
    code = f"import sys, smsid.estimation.identify; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
