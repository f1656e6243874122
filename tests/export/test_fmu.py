"""The FMU run by fmpy, against the simulation and a formula."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from smsid.errors import MissingDependencyError
from smsid.export.fmu import write_fmu
from smsid.model import build_model
from smsid.simulate import Constant, Inputs, simulate

from .test_linear_plant import craft


def test_the_unit_moves_as_simulated(tmp_path):
    fmpy = pytest.importorskip("fmpy")
    pytest.importorskip("pythonfmu3")
    file = write_fmu(craft(tmp_path), tmp_path / "craft.fmu")
    description = fmpy.read_model_description(str(file))
    assert description.fmiVersion == "3.0" and description.coSimulation is not None
    inputs = {v.name for v in description.modelVariables if v.causality == "input"}
    assert inputs == {*(f"{w}_{a}" for w in ("force", "torque") for a in "xyz"), "w_wheel_torque"}
    columns = [("time", float), ("force_x", float), ("w_wheel_torque", float)]
    drive = np.array([(0.0, 3.0, 0.01), (5.0, 3.0, 0.01)], dtype=columns)
    rows = fmpy.simulate_fmu(str(file), stop_time=2.0, step_size=0.1, output_interval=0.1, input=drive)
    model = build_model(craft(tmp_path))
    run = simulate(model, Inputs(force=Constant([3.0, 0, 0]), wheel_torque=Constant([0.01])), 2.0)
    end = run.states(np.array([2.0]))
    assert rows["bus_position_x"][-1] == pytest.approx(end.q[0, 0], abs=1e-9)
    assert rows["w_rate"][-1] == pytest.approx(end.v[0, model.wheels.v[0]], abs=1e-9)
    assert rows["bus_position_x"][-1] == pytest.approx(0.5 * 3.0 / 112.0 * 4.0, rel=0.01)


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pythonfmu3", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[fmu\]"):
        write_fmu(craft(tmp_path), tmp_path / "craft.fmu")
