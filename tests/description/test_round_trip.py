"""A description saved and loaded is the same description, in the same folder or another."""

from __future__ import annotations

import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.description import Arm, Description, Mount, Wheel, load_description, save_description
from smsid.effects import JointFriction, ModalAppendage, Mode, Slosh
from smsid.errors import DescriptionError, SmsidError
from smsid.model import build_model

URDF = Path(__file__).resolve().parents[2] / "urdf"
SHIPPED = sorted(URDF.glob("*.toml"))

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=1e-300, max_value=1e300)
vector = st.tuples(finite, finite, finite)
ratio = st.floats(min_value=0.0, max_value=1e300)


def files_of(description: Description) -> set[Path]:
    """The files a description refers to."""
    names = [description.urdf, *(a.urdf for a in description.arm if a.urdf)]
    return {(description.folder / n).resolve() for n in names}


def comparable(description: Description) -> dict:
    """All but where the files are."""
    kept = {k: v for k, v in description if k not in ("urdf", "folder", "package_dirs", "arm")}
    return {**kept, "arm": [{k: v for k, v in a if k != "urdf"} for a in description.arm]}


@pytest.mark.parametrize("file", SHIPPED, ids=lambda f: f.stem)
def test_saved_into_another_folder_it_is_the_same_spacecraft(file, tmp_path):
    before = load_description(file)
    target = tmp_path / "deep" / "er"
    target.mkdir(parents=True)
    save_description(before, target / "again.toml")
    after = load_description(target / "again.toml")
    assert comparable(after) == comparable(before)
    assert files_of(after) == files_of(before)
    one, other = build_model(before), build_model(after)
    assert list(one.pin.names) == list(other.pin.names)
    np.testing.assert_array_equal(one.home, other.home)
    for a, b in zip(one.pin.inertias, other.pin.inertias, strict=True):
        np.testing.assert_array_equal(a.toDynamicParameters(), b.toDynamicParameters())


@pytest.mark.parametrize("file", SHIPPED, ids=lambda f: f.stem)
def test_a_second_round_changes_nothing(file, tmp_path):
    save_description(load_description(file), tmp_path / "a.toml")
    save_description(load_description(tmp_path / "a.toml"), tmp_path / "b.toml")
    assert (tmp_path / "a.toml").read_text() == (tmp_path / "b.toml").read_text()
    assert load_description(tmp_path / "a.toml") == load_description(tmp_path / "b.toml")


@st.composite
def descriptions(draw) -> Description:
    modes = draw(
        st.lists(
            st.builds(
                Mode, frequency=positive, damping=ratio, translation=vector, rotation=vector,
                shape=st.tuples(vector, vector),
            ),
            max_size=3,
        )
    )  # fmt: skip
    effects = (
        Slosh(
            name="tank",
            position=draw(vector),
            mass=draw(positive),
            stiffness=draw(st.tuples(ratio, ratio, ratio)),
            damping=draw(st.tuples(ratio, ratio, ratio)),
            prior=draw(st.dictionaries(st.sampled_from(["mass", "stiffness.y"]), positive)),
        ),
        JointFriction(name="f", joint="shoulder", viscous=draw(ratio), coulomb=draw(ratio)),
        ModalAppendage(
            name="sail",
            frame=draw(st.none() | st.text(max_size=5)),
            position=draw(vector),
            mass=draw(positive),
            center_of_mass=draw(vector),
            inertia=draw(st.tuples(*[finite] * 6)),
            mode=tuple(modes),
            stations=draw(st.tuples(vector, vector)),
        ),
    )
    axis = draw(st.tuples(*[st.floats(-10.0, 10.0)] * 3).filter(lambda a: np.dot(a, a) > 1e-6))
    arm = Arm(
        name="arm",
        urdf=draw(st.sampled_from(["arm.urdf", "parts/arm.urdf", "../arm.urdf"])),
        mount=Mount(xyz=draw(vector), rpy=draw(vector)),
        home=draw(st.dictionaries(st.text(max_size=5), finite, max_size=3)),
        inertias=draw(st.sampled_from(["checked", "trusted"])),
    )
    return Description(
        name=draw(st.text(max_size=8)),
        urdf="bus.urdf",
        root=draw(st.sampled_from(["free", "fixed"])),
        gravity=draw(vector),
        wheel=(Wheel(name="w", axis=axis, position=draw(vector), inertia=draw(positive)),),
        arm=(arm, Arm(name="none", joints=())),
        effect=effects,
    )


@settings(max_examples=80, deadline=None)
@given(descriptions())
def test_any_values_survive_the_file(description):
    with tempfile.TemporaryDirectory() as folder:
        here = description.model_copy(update={"folder": Path(folder)})
        save_description(here, Path(folder) / "x.toml")
        assert load_description(Path(folder) / "x.toml") == here
        (Path(folder) / "sub").mkdir()
        save_description(here, Path(folder) / "sub" / "y.toml")
        there = load_description(Path(folder) / "sub" / "y.toml")
        assert comparable(there) == comparable(here)
        assert files_of(there) == files_of(here)


def test_a_urdf_alone_is_a_description():
    description = load_description(URDF / "paper_sms.urdf")
    assert description.name == "paper_sms"
    model = build_model(description)
    assert model.arm_joints.names == ("joint1", "joint2", "joint3")
    assert model.mass == pytest.approx(2110.0)


def test_files_hold_no_absolute_path_and_no_empty_keys(tmp_path):
    save_description(load_description(URDF / "two_arm_sms.toml"), tmp_path / "x.toml")
    tables = tomllib.loads((tmp_path / "x.toml").read_text())
    assert not Path(tables["urdf"]).is_absolute()
    assert all(not Path(a["urdf"]).is_absolute() for a in tables["arm"])
    assert "folder" not in tables and "package_dirs" not in tables
    assert tables["schema"] == 1


def test_saving_into_no_folder_fails_and_leaves_nothing(tmp_path):
    with pytest.raises(SmsidError, match="does not exist"):
        save_description(load_description(URDF / "paper_sms.toml"), tmp_path / "none" / "x.toml")
    assert list(tmp_path.iterdir()) == []


def test_replacing_effects_and_sensors():
    description = load_description(URDF / "paper_sms.toml")
    heavier = description.get_effect("tank").with_values({"tank.mass": 60.0})
    changed = description.with_effects(heavier)
    assert build_model(changed).mass == pytest.approx(build_model(description).mass + 10.4)
    assert [e.name for e in changed.effect] == [e.name for e in description.effect]
    assert changed.folder == description.folder
    one = description.sensor[0]
    assert description.with_sensors(one).sensor == (one,)
    with pytest.raises(DescriptionError, match="two sensors are named 'pose'"):
        description.with_sensors(one, one)
    with pytest.raises(DescriptionError, match=r"no effect 'tnak'. Did you mean 'tank'\?"):
        description.get_effect("tnak")
