"""An effect of the user's own, hidden in MuJoCo, is found by the name its class gives it."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from smsid.description import load_description
from smsid.effects import ActuatorDelay, Counterpart, base
from smsid.errors import DescriptionError
from smsid.export import export_folder
from smsid.paths import urdf_folder
from tests.estimation.effect_cases import EffectCase, fly, identified

from .effect import after
from .flight import write_run
from .plant import Change
from .study import diagnosis_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "08_add_an_effect.py"
PULL = 0.5  # [N m/rad^3]


@pytest.fixture
def cable_drag(monkeypatch):
    """The example's class, in the catalogue for as long as a test runs."""
    monkeypatch.setattr(base, "_CATALOGUE", dict(base._CATALOGUE))
    spec = importlib.util.spec_from_file_location("add_an_effect", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # pydantic finds the annotations of a class by its module
    monkeypatch.setitem(sys.modules, "add_an_effect", module)
    spec.loader.exec_module(module)
    return module.CableDrag


def cable(joint: str, pull: float, onset: float | None = None) -> Change:
    """A torque against the cube of the angle."""

    def make(plant):
        iq, iv = plant.q_of(joint), plant.v_of(joint)

        def force():
            if after(onset, plant.data.time):
                plant.passive[iv] -= pull * plant.qpos[iq] * plant.qpos[iq] ** 2

        return force

    return Change(force=make)


def test_user_effect_is_found(cable_drag, tmp_path):
    files = write_run("arm", tmp_path, [31, 79], [cable("joint2", PULL)])
    document = diagnosis_of(files, tmp_path)
    assert document["verdict"] == "explained", document["sentence"]
    (cause,) = document["causes"]
    assert (cause["effect"], cause["location"], cause["shape"]) == ("cable_drag", "joint2", "cable")
    (value,) = cause["parameters"]
    assert value["name"] == "cable_joint2.pull"
    assert abs(value["value"] - PULL) < 3.0 * value["sigma"]
    assert value["sigma"] < 0.1 * PULL


def test_user_effect_is_identified(cable_drag, tmp_path):
    """Listed in the description, its parameter is estimated with the tank, the bodies and the rest."""
    case = EffectCase("cable_drag", lambda _: cable("joint2", PULL), {"joint": "joint2"}, {"pull": PULL})
    flight = fly(case, 0, tmp_path)
    known = flight.description.get_effect("cause").model_copy(update={"known": ("rest",)})
    found = identified(
        replace(
            flight,
            description=flight.description.with_effects(known),
            recording=flight.recording.window(0.0, 8.0),
        )
    )
    assert found.quality.judgement == "explained"
    value = found.estimate["cause.pull"]
    assert abs(value.value - PULL) < 3.0 * value.sigma and value.sigma < 0.1 * PULL


def test_user_effect_is_exported_or_refused_by_name(cable_drag, tmp_path):
    craft = load_description(urdf_folder() / "paper_sms.toml").with_effects(
        cable_drag(name="cable", joint="joint2", pull=PULL)
    )
    with pytest.raises(DescriptionError, match=r"'cable' \(cable_drag\): its forces follow"):
        export_folder(craft, tmp_path / "all")
    export_folder(craft, tmp_path / "without", mujoco=False)
    assert load_description(tmp_path / "without" / "paper_sms.toml").get_effect("cable").pull == PULL

    class Slack(cable_drag):
        def counterpart(self, limits):
            return Counterpart({self.joint: 1.0}, damping=self.pull, note=f"'{self.name}' as a damper")

    damped = craft.with_effects(Slack(name="cable", joint="joint2", pull=PULL))
    assert "'cable' as a damper" in export_folder(damped, tmp_path / "damped").notes
    late = ActuatorDelay(name="late", actuator="wheel_x", delay=0.1)
    beside = export_folder(damped.with_effects(late), tmp_path / "late").notes
    assert "late: on commands or readings, so not in the MuJoCo XML" in beside
    spec = mujoco.MjModel.from_xml_path(str(tmp_path / "damped" / "paper_sms.xml"))
    assert spec.joint("joint2").damping == pytest.approx(PULL)


def test_source_of_the_effect_is_short(cable_drag):
    """Simulated, saved and looked for in fewer than 60 lines."""
    lines = EXAMPLE.read_text(encoding="utf-8").split("@register")[1].split("\ndef ")[0]
    assert len(lines.strip().splitlines()) < 60
