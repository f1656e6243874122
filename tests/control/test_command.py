"""``smsid control``: from description and estimate to an examined controller, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pinocchio as pin
import pytest
import typer
from control_cases import URDF, described, paper
from test_identified_model import ARM, true_estimate, wrong_description
from typer.testing import CliRunner

from smsid.cli.control import control_command
from smsid.control._statespace import hinf_norm
from smsid.control.controller_file import load_controller
from smsid.control.design import DesignRequest, design
from smsid.control.identified_model import inertia_at
from smsid.control.reduced import ReducedDynamics
from smsid.control.robust_term import rigid_loop
from smsid.description import Description
from smsid.errors import ControlError
from smsid.identify.estimate import Estimate, classify, save_estimate

APP = typer.Typer()
APP.command()(control_command)
DESCRIPTION = str(URDF / "paper_sms.toml")


def invoke(*arguments: object):
    return CliRunner().invoke(APP, [str(a) for a in arguments])


def test_the_command_puts_the_estimate_into_the_controller(tmp_path):
    """The description is 20 to 30 % wrong; the saved controller's model is the true spacecraft's."""
    wrong_description(tmp_path)
    described = (URDF / "paper_sms.toml").read_text().replace("paper_sms.urdf", "wrong.urdf")
    (tmp_path / "wrong.toml").write_text(described)
    save_estimate(true_estimate(1e-3), tmp_path / "estimate.json")
    output = tmp_path / "controller.json"
    result = invoke(
        tmp_path / "wrong.toml",
        tmp_path / "estimate.json",
        *("--tune", "--rate", 10, "--samples", 50, "--crossover", 5, "-o", output),
    )
    assert result.exit_code == 0, result.exception
    document = json.loads(output.read_text())
    model = ReducedDynamics(paper())
    bodies = {name: np.array(theta) for name, theta in document["model"]["bodies"].items()}
    known = zip(list(model.pin.names)[1:], list(model.pin.inertias)[1:], strict=True)
    model = model.with_inertias([
        pin.Inertia.FromDynamicParameters(bodies[name]) if bodies[name][0] > 0.0 else inertia
        for name, inertia in known
    ])  # fmt: skip
    for angles in ARM:
        h = inertia_at(ReducedDynamics(paper()), angles)
        np.testing.assert_allclose(inertia_at(model, angles), h, atol=1e-4 * np.abs(h).max())
    assert document["gamma"] <= 1.0 + 1e-6 and document["coordinates"][3:] == ["joint1", "joint2", "joint3"]
    assert 1e-4 < document["weights"]["uncertainty"]["value"] < 1e-2
    assert document["robustness"]["unstable"] == 0 and document["robustness"]["mu_upper"] < 1.0
    saved = load_controller(output)
    assert saved.rate == 10.0
    gains = saved.gains
    loop = rigid_loop(gains.proportional, gains.derivative, saved.term)
    assert loop.stable and hinf_norm(loop)[0] < np.inf
    frequency = np.sqrt(np.diag(gains.proportional))
    bands = [(m["low"] / 1.25, m["high"] * 1.25) for m in document["natural_frequencies"]]
    assert len(bands) == 12 and not any(low <= w <= high for w in frequency for low, high in bands)
    assert "sampled plants unstable" in result.stdout and "panel.mode1" in result.stdout


def test_a_craft_without_arm_is_refused_for_that():
    """Not for the encoder that it has no joints for."""
    sensors = [s for s in described().sensor if s.kind in ("pose", "imu", "tachometer")]
    bare = Description(name="bare", urdf="bus.urdf", folder=URDF, wheel=described().wheel, sensor=sensors)
    with pytest.raises(ControlError, match="has no arm"):
        design(bare, None, DesignRequest(uncertainty=0.05), np.random.default_rng(1))


def test_a_stated_uncertainty_needs_no_estimate(tmp_path):
    output = tmp_path / "controller.json"
    result = invoke(DESCRIPTION, "--uncertainty", 0.05, "--gains", "1,2", "--rate", 10, "-o", output)
    assert result.exit_code == 0, result.exception
    document = json.loads(output.read_text())
    assert document["weights"]["uncertainty"]["value"] == 0.05 and "robustness" not in document
    assert document["model"]["identified"] == []
    gains = load_controller(output).gains
    np.testing.assert_allclose(np.diag(gains.derivative), 2.0)


def test_an_estimate_without_intervals_is_refused_for_the_weights():
    without = [
        classify(p.name, p.value, p.unit, np.nan, p.group) if p.name == "link3.mx" else p
        for p in true_estimate().parameters
    ]
    estimate = Estimate("paper_sms", "paper", tuple(without))
    with pytest.raises(ControlError, match=r"1 parameters have no interval, the first is 'link3\.mx'"):
        design(paper().description, estimate, DesignRequest(rate=10.0), np.random.default_rng(0))


def test_nothing_to_design_for_is_refused():
    with pytest.raises(ControlError, match="gains and an uncertainty have to be stated"):
        design(paper().description, None, DesignRequest(), np.random.default_rng(0))
