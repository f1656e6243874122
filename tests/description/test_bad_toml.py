"""Every bad TOML gives a DescriptionError whose message names the place and the mend."""

from __future__ import annotations

from pathlib import Path

import pytest

from smsid.description import load_description
from smsid.errors import DescriptionError
from smsid.model import build_model

from .pieces import ARM, BUS, HEAD, IMU, PANEL, SAIL, TANK, WHEEL

URDF = Path(__file__).resolve().parents[2] / "urdf"


def test_what_the_bad_inputs_are_made_of_is_good(tmp_path):
    (tmp_path / "bus.urdf").write_text(BUS)
    (tmp_path / "x.toml").write_text(HEAD + PANEL + TANK + SAIL + IMU + WHEEL + ARM)
    model = build_model(load_description(tmp_path / "x.toml"))
    assert len(model.appendages) == 2 and len(model.slosh) == 1 and len(model.wheels) == 1


TOML_CASES = {
    "unknown key at the top": ('urfd = "a"\n', ["urfd", "did you mean 'urdf'"]),
    "unknown key in a table": ("[thrust]\npiont = [0.0, 0.0, 0.0]\n", ["thrust, piont", "'point'"]),
    "unknown key in a wheel": (WHEEL + "inerta = 0.1\n", ["wheel number 1 ('w'), inerta", "'inertia'"]),
    "unknown key in an arm": (ARM + 'urdff = "a"\n', ["arm number 1 ('arm'), urdff", "'urdf'"]),
    "unknown key in a mount": (
        ARM + 'urdf = "bus.urdf"\nmount = { fram = "bus" }\n',
        ["arm number 1 ('arm'), mount, fram", "'frame'"],
    ),
    "unknown key in an effect": (
        TANK + PANEL + "thicknes = 0.001\n",
        ["effect number 2 ('panel'), thicknes", "'thickness'"],
    ),
    "the nearest key is of the same table": (TANK + "lenght = 1.0\n", ["lenght", "known here", "stiffness"]),
    "unknown key in a mode": (
        SAIL + "frequence = 1\n",
        ["('sail'), mode number 1, frequence", "'frequency'"],
    ),
    "unknown key in a sensor": (
        IMU + "positon = [0.0, 0.0, 0.0]\n",
        ["sensor number 1 ('imu')", "'position'"],
    ),
    "unknown key in a sensor's errors": (
        IMU + "errors = { acceleration = { noise_sigmas = 1e-4 } }\n",
        ["sensor number 1 ('imu'), errors, acceleration, noise_sigmas", "'noise_sigma'"],
    ),
    "wrong type": (PANEL.replace("2.0", '"long"', 1), ["('panel'), length", "valid number", "'long'"]),
    "a number in quotes": (TANK.replace("5.0", '"5.0"'), ["('tank'), mass", "valid number", "'5.0'"]),
    "a truth value": (
        WHEEL.replace("0.1", "true"),
        ["wheel number 1 ('w'), inertia", "valid number", "True"],
    ),
    "a string in a vector": (
        "gravity = [0.0, 0.0, '-9.81']\n",
        ["gravity number 3: Input should be a valid number, not '-9.81'"],
    ),
    "a truth value at home": (ARM + "home = { shoulder = true }\n", ["('arm'), home, shoulder", "not True"]),
    "a string in a mode": (SAIL.replace("0.5", "'0.5'", 1), ["('sail'), mode number 1, frequency", "number"]),
    "a vector of two": (TANK.replace("[0.4, 0.4, 0.4]", "[0.4, 0.4]"), ["('tank'), stiffness", "3 items"]),
    "missing key": (TANK.replace("mass = 5.0\n", ""), ["effect number 1 ('tank'), mass", "missing"]),
    "one bracket": ("[effect]\nkind = 'slosh'\n", ["effect", "[[effect]] with two brackets"]),
    "NaN in an effect": (TANK.replace("5.0", "nan"), ["('tank'), mass", "finite"]),
    "NaN in a vector": (
        TANK.replace("[0.0, 0.0, 0.0]", "[0.0, nan, 0.0]", 1),
        ["('tank'), position", "finite"],
    ),
    "infinite wheel": (WHEEL.replace("0.1", "inf"), ["wheel number 1 ('w'), inertia", "finite"]),
    "NaN at home": (ARM + "home = { shoulder = nan }\n", ["('arm'), home, shoulder", "finite"]),
    "NaN in a mode": (SAIL.replace("0.5", "nan", 1), ["('sail'), mode number 1, frequency", "finite"]),
    "negative mass": (TANK.replace("5.0", "-5.0"), ["('tank'), mass", "greater than 0", "-5.0"]),
    "negative stiffness": (
        TANK.replace("0.4]", "-0.4]"),
        ["effect number 1 ('tank')", "stiffness.z", "-0.4"],
    ),
    "negative frequency": (SAIL.replace("0.5", "-0.5", 1), ["mode number 1, frequency", "greater than 0"]),
    "unknown kind": (TANK.replace('"slosh"', '"slsh"'), ["effect number 1 ('tank')", "slsh", "'slosh'"]),
    "no kind": (TANK.replace('kind = "slosh"\n', ""), ["effect number 1 ('tank')", "beam_appendage, "]),
    "prior of nothing": (
        TANK + "prior = { mas = 1.0 }\n",
        ["('tank')", "'mas', no parameter", "stiffness.x"],
    ),
    "prior not positive": (TANK + "prior = { mass = 0.0 }\n", ["('tank'), prior, mass", "greater than 0"]),
    "unknown preset": (IMU + 'preset = "refrence"\n', ["sensor number 1 ('imu')", "refrence", "reference"]),
    "unknown sensor kind": (IMU.replace('"imu"\nrate', '"imi"\nrate'), ["('imu'), kind", "'imi'"]),
    "sensor on no appendage": (
        PANEL + IMU.replace('kind = "imu"', 'kind = "accelerometers"\nappendage = "pannel"'),
        ["'pannel'", "Did you mean 'panel'?"],
    ),
    "two wheels of a name": (WHEEL + WHEEL, ["two wheels are named 'w'", "rename"]),
    "two arms of a name": (ARM + ARM, ["two arms are named 'arm'"]),
    "two effects of a name": (TANK + TANK, ["two effects are named 'tank'"]),
    "two sensors of a name": (IMU + IMU, ["two sensors are named 'imu'"]),
    "wheel named like an effect": (TANK + WHEEL.replace('"w"', '"tank"'), ["'tank'", "Rename"]),
    "a name with a dot": (TANK.replace('"tank"', '"a.b"'), ["('a.b'), name", "pattern"]),
    "wheel without inertia": ('[[wheel]]\nname = "w"\n', ["wheel number 1 ('w')", "`inertia`", "`joint`"]),
    "wheel without axis": (WHEEL + "axis = [0.0, 0.0, 0.0]\n", ["'w'", "zero `axis`"]),
    "wheel joint not there": (
        '[[wheel]]\nname = "w"\njoint = "sholder"\n',
        ["[[wheel]] 'w'", "'sholder'", "'shoulder'"],
    ),
    "arm joint not there": (ARM + 'joints = ["sholder"]\n', ["[[arm]] 'arm'", "Did you mean 'shoulder'?"]),
    "joint of two arms": (
        ARM + 'joints = ["shoulder"]\n' + ARM.replace("arm", "b").replace("[[b]]", "[[arm]]"),
        ["'shoulder' belongs to two"],
    ),
    "fixing no joint": (
        ARM + 'urdf = "bus.urdf"\nfixed = ["sholder"]\n',
        ["[[arm]] 'arm'", "`fixed`", "Did you mean 'shoulder'?"],
    ),
    "home of no joint": (ARM + "home = { elbow = 0.1 }\n", ["[[arm]] 'arm'", "'elbow'", "shoulder"]),
    "friction of no joint": (
        '[[effect]]\nkind = "joint_friction"\nname = "f"\njoint = "sholder"\n',
        ["[[effect]] 'f'", "Did you mean 'shoulder'?"],
    ),
    "effect on no frame": (TANK + 'frame = "arm_mout"\n', ["[[effect]] 'tank'", "Did you mean 'arm_mount'?"]),
    "arm mounted on no frame": (
        ARM + 'urdf = "bus.urdf"\nmount = { frame = "arm_mout" }\n',
        ["[[arm]] 'arm'", "Did you mean 'arm_mount'?"],
    ),
    "mount without a part": (ARM + 'mount = { frame = "bus" }\n', ["('arm')", "`mount`", "`urdf`"]),
    "two sources of an arm": (ARM + 'urdf = "a"\nrobot = "b"\n', ["('arm')", "one of"]),
    "arm's URDF missing": (ARM + 'urdf = "none.urdf"\n', ["[[arm]] 'arm'", "none.urdf", "does not exist"]),
    "wheels with more inertia than the bus": (
        WHEEL.replace("0.1", "30.0"),
        ["[[wheel]] 'w'", "left to body 'bus'", "inertia_in_bus"],
    ),
    "modes with more mass than the bus": (
        SAIL.replace("[0.0, 0.0, 1.0]", "[0.0, 0.0, 15.0]"),
        ["[[effect]] 'sail'", "left to body 'bus'", "participation"],
    ),
    "a mode that moves nothing": (
        SAIL.replace("1.0]\nrotation = [0.0, -1.0, 0.0]", "0.0]\nrotation = [0.0, 0.0, 0.0]"),
        ["[[effect]] 'sail'", "moves nothing", "Remove"],
    ),
    "a shape too many": (SAIL + "shape = [[0.0, 0.0, 1.0]]\n", ["('sail')", "mode 1", "0 stations"]),
    "a station beyond the plate": (PANEL.replace("[1.0]", "[1000.0]"), ["('panel')", "1000.0", "length 2.0"]),
    "folder is no key": ('folder = "."\n', ["folder", "remove"]),
}


@pytest.mark.parametrize("case", TOML_CASES)
def test_bad_toml(fails, case):
    tables, expected = TOML_CASES[case]
    text = fails(HEAD + tables)
    for piece in expected:
        assert piece in text


@pytest.mark.parametrize("length", range(60, 2000, 97))
def test_toml_cut_short_anywhere_is_a_description_error_or_a_shorter_spacecraft(tmp_path, length):
    """Cut between two tables, a TOML is still one; cut elsewhere, it must be refused."""
    whole = (URDF / "paper_sms.toml").read_text()
    cut = whole[:length]
    file = tmp_path / "cut.toml"
    file.write_text(cut)
    try:
        found = load_description(file)
    except DescriptionError as error:
        assert "cut.toml" in str(error)
    else:
        assert found.urdf == "paper_sms.urdf"
        assert cut.count("[[effect]]") == len(found.effect)


def test_several_problems_are_all_told(fails):
    text = fails(HEAD + TANK.replace("5.0", "-5.0") + "nonsense = 1\n" + WHEEL.replace("0.1", "-0.1"))
    assert "mass" in text and "nonsense" in text and "wheel number 1" in text


def test_an_error_carries_its_problems_as_evidence(tmp_path):
    (tmp_path / "x.toml").write_text(HEAD + TANK.replace("5.0", "-5.0"))
    with pytest.raises(DescriptionError) as caught:
        load_description(tmp_path / "x.toml")
    (problem,) = caught.value.evidence["problems"]
    assert problem.startswith("effect number 1 ('tank'), mass:")
    assert "docs/description.md" in caught.value.advice
