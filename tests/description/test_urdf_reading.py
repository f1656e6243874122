"""A URDF is read strictly, by our own reading, in the encoding it declares."""

from __future__ import annotations

import re

import numpy as np
import pytest

from smsid.description import load_description
from smsid.description.urdf_check import read_urdf
from smsid.description.urdf_reading import parse_urdf
from smsid.errors import DescriptionError
from smsid.model import build_model

from .pieces import BUS


@pytest.mark.parametrize("value", [" 10 ", "\t10", "1e1", "+10."])
def test_blanks_around_a_number_do_not_matter(tmp_path, value):
    (tmp_path / "x.urdf").write_text(BUS.replace('mass value="2"', f'mass value="{value}"'))
    assert build_model(load_description(tmp_path / "x.urdf")).mass == pytest.approx(110.0)


@pytest.mark.parametrize("value", ["1_0", "10 kg", "0x10", ""])
def test_what_is_no_number_is_refused(tmp_path, value):
    (tmp_path / "x.urdf").write_text(BUS.replace('mass value="2"', f'mass value="{value}"'))
    with pytest.raises(DescriptionError, match="mass of link 'upper'"):
        build_model(load_description(tmp_path / "x.urdf"))


def test_declared_encoding_is_honoured(tmp_path):
    text = '<?xml version="1.0" encoding="iso-8859-1"?>\n<!-- Gr\u00f6\u00dfe -->' + BUS
    (tmp_path / "x.urdf").write_bytes(text.encode("latin-1"))
    assert build_model(load_description(tmp_path / "x.urdf")).mass == pytest.approx(102.0)


def test_inertia_is_turned_into_link_axes(tmp_path):
    text = BUS.replace(
        '<mass value="2"/>', '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><mass value="2"/>'
    )
    text = text.replace('ixx="0.1" iyy="0.1" izz="0.1"', 'ixx="0.1" iyy="0.2" izz="0.25"')
    (tmp_path / "x.urdf").write_text(text)
    link = parse_urdf(read_urdf(tmp_path / "x.urdf"), "x").links["upper"]
    np.testing.assert_allclose(link.inertia, np.diag([0.2, 0.1, 0.25]), atol=1e-15)
    np.testing.assert_array_equal(link.centre, [1, 2, 3])
    body = build_model(load_description(tmp_path / "x.urdf")).pin.inertias[2]
    np.testing.assert_allclose(body.inertia, link.inertia, atol=1e-15)


def test_gear_of_a_transmission_is_named_as_unused(tmp_path):
    more = "<transmission name='t1'><joint name='shoulder'/><actuator name='m'><mechanicalReduction>50"
    more += "</mechanicalReduction></actuator></transmission></robot>"
    (tmp_path / "x.urdf").write_text(BUS.replace("</robot>", more))
    reading = parse_urdf(read_urdf(tmp_path / "x.urdf"), "x")
    assert "t1 (mechanicalReduction 50)" in reading.unused[0]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<axis xyz", "<axes xyz", "<axes> of joint 'shoulder'"),
        ("<axis xyz", "<axis xzy", "xzy in <axis> of joint 'shoulder'"),
        (
            "</joint>",
            '<dynamics damping="1" spring_stiffness="3"/></joint>',
            "spring_stiffness in <dynamics>",
        ),
        (
            "</robot>",
            '<gazebo reference="shoulder"><springStiffness>3</springStiffness></gazebo></robot>',
            "shoulder (springStiffness 3)",
        ),
        ("<mass value", '<Mass value="3"/><mass value', "<Mass> of link"),
        (
            "<inertial>",
            '<visual><geometry><box size="1 inf 1"/></geometry></visual><inertial>',
            'size="1 inf 1"): not the numbers that a shape has',
        ),
    ],
)
def test_what_a_urdf_does_not_know_is_named_as_unused(old, new, told):
    assert old in BUS
    assert any(told in what for what in parse_urdf(BUS.replace(old, new, 1), "x").unused)
    assert parse_urdf(BUS, "x").unused == ()


@pytest.mark.parametrize(
    ("kind", "limit", "told"),
    [
        ("revolute", '<limit lower="-1" upper="1"/>', "has a <limit> without effort and velocity"),
        ("prismatic", '<limit lower="-1" upper="1" effort="3"/>', "has a <limit> without velocity"),
        ("revolute", "", "has no <limit>"),
        ("continuous", "<limit effort='3'/>", "has a <limit> without velocity"),
    ],
)
def test_limits_that_a_urdf_has_to_have_are_asked_for_by_name(kind, limit, told):
    """urdfdom refuses them as 'not a valid URDF model'."""
    found = re.sub(r'type="\w+"', f'type="{kind}"', re.sub("<limit[^>]*/>", "", BUS), count=1)
    found = found.replace("</joint>", f"{limit}</joint>", 1)
    with pytest.raises(DescriptionError, match=f"Joint 'shoulder' of x is {kind} and {told}"):
        parse_urdf(found, "x")
