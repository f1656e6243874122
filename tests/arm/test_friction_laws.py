"""Laws of friction beyond viscous and Coulomb are identified with intervals, and hinted at where missing."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.arm import identify_arm, with_friction_laws, with_joint_effects
from smsid.arm._residual_dependence import leftover_sentences
from smsid.description import Description
from smsid.errors import DescriptionError
from smsid.recording import Recording

URDF = """<robot name="axis"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0.3 0"/><mass value="4"/>
<inertia ixx="0.3" iyy="0.1" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="1 0 0"/>
<limit lower="-4" upper="4" effort="50" velocity="5"/></joint></robot>"""
WIDTH = 0.02
LAWS = {
    "direction": (lambda s: 0.6 * np.abs(s["v"]), {"viscous_direction": 0.6}),
    "quadratic": (lambda s: 0.3 * s["v"] * np.abs(s["v"]), {"quadratic": 0.3}),
    "cubic": (lambda s: 0.2 * s["v"] ** 3, {"cubic": 0.2}),
    "stribeck": (lambda s: 1.2 * np.exp(-((s["v"] / 0.15) ** 2)) * s["sign"], {"stribeck": 1.2}),
    "load": (lambda s: 0.08 * np.abs(s["load"]) * s["sign"], {"load": 0.08}),
    "position": (
        lambda s: (0.5 * np.cos(s["q"]) - 0.4 * np.sin(s["q"])) * s["sign"],
        {"position_cos": 0.5, "position_sin": -0.4},
    ),
    "temperature": (
        lambda s: (s["T"] - 20.0) * (-0.02 * s["v"] - 0.01 * s["sign"]),
        {"viscous_temperature": -0.02, "coulomb_temperature": -0.01},
    ),
}


@pytest.fixture
def arm(tmp_path) -> Description:
    (tmp_path / "axis.urdf").write_text(URDF)
    bare = Description(
        name="axis", urdf="axis.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81)
    )
    return with_joint_effects(bare, ("hinge",), "joint_friction", "torque_offset")


def log(law: str, seed: int = 0) -> Recording:
    """Plain numpy: I qdd + m g c cos q + friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0, 0.01)
    omega, phase = 2.0 * np.pi * 0.08 * np.array([1, 2, 3, 5]), rng.uniform(0.0, 6.0, 4)
    size = np.array([0.7, 0.5, 0.3, 0.15])
    arg = omega[:, None] * t + phase[:, None]
    q, v = size @ np.sin(arg), (size * omega) @ np.cos(arg)
    rigid = (0.3 + 4.0 * 0.09) * (-(size * omega**2) @ np.sin(arg)) + 4.0 * 9.81 * 0.3 * np.cos(q)
    s = {"q": q, "v": v, "sign": np.tanh(v / WIDTH), "T": 20.0 + 0.5 * t}
    load = torque = rigid + 1.0 * v + 2.0 * s["sign"] + 0.3
    for _ in range(50):
        torque = load + LAWS[law][0](s | {"load": torque})
    channels = {
        "encoder.joint_position": q[:, None] + 1e-5 * rng.normal(size=(t.size, 1)),
        "drive.joint_torque": torque[:, None] + 0.1 * rng.normal(size=(t.size, 1)),
        "drive.joint_temperature": s["T"][:, None],
    }
    return Recording.from_arrays(t, channels, labels={"joint": ("hinge",)}, role="estimation", name="log")


@pytest.mark.parametrize("law", LAWS)
def test_a_law_is_found_within_its_interval_and_predicts(arm, law):
    recording = log(law)
    found = identify_arm(with_friction_laws(arm, ("hinge",), [law]), recording)
    truth = {"viscous": 1.0, "coulomb": 2.0, **LAWS[law][1]}
    for field, value in truth.items():
        p = found.estimate[f"friction_hinge.{field}"]
        assert abs(p.value - value) < 3.3 * p.sigma < 0.6 * max(abs(value), 0.5), (field, p.value, p.sigma)
    held = log(law, seed=1).with_role("validation")
    assert found.judge(held).rmse["hinge"] < 0.12
    assert not any("hint" in s for s in leftover_sentences(found))


@pytest.mark.parametrize("law", ["direction", "load", "stribeck", "temperature"])
def test_a_law_that_is_missing_is_hinted_at(arm, law):
    found = identify_arm(arm, log(law))
    hints = [s for s in leftover_sentences(found) if s.startswith("hint")]
    assert len(hints) == 1 and f"--friction {law}=hinge" in hints[0]


def test_plain_friction_gives_no_hint(arm):
    LAWS["none"] = (lambda s: 0.0, {})
    try:
        found = identify_arm(arm, log("none"))
    finally:
        del LAWS["none"]
    assert not any("hint" in s for s in leftover_sentences(found))


def test_stribecks_rate_is_found_with_its_uncertainty(arm):
    found = identify_arm(with_friction_laws(arm, ("hinge",), ["stribeck"]), log("stribeck"))
    rate = next(s for s in found.shapes if s.field == "stribeck_rate")
    assert rate.status == "found" and abs(np.log(rate.value / 0.15)) < 3.3 * rate.sigma < 1.0
    assert found.description.get_effect("friction_hinge").stribeck_rate == rate.value


def test_wrong_names_and_what_is_not_measured_are_told(arm):
    with pytest.raises(DescriptionError, match="no law of friction 'tustin'"):
        with_friction_laws(arm, ("hinge",), ["tustin"])
    with pytest.raises(DescriptionError, match="fits no joint"):
        with_friction_laws(arm, ("hinge",), ["load=elbow"])
    cold = log("direction").without("drive.joint_temperature")
    with pytest.raises(DescriptionError, match="joint_temperature"):
        identify_arm(with_friction_laws(arm, ("hinge",), ["temperature"]), cold)
