"""Combinations that data tell apart: by the information alone."""

import numpy as np
import pytest

from smsid.arm.identify import rigid_arm, structural_base
from smsid.arm.setup import arm_description
from smsid.estimation.inertial_combinations import (
    about_centre,
    combination_name,
    combinations,
    rounded_factor,
    terms_of_total,
)
from smsid.likelihood.combinations import Combination
from smsid.likelihood.parameters import body_size
from smsid.model.regressor import Regressor
from smsid.paths import urdf_folder


def test_everything_is_told_by_enough_information():
    matrix, kept = combinations(100.0 * np.eye(4))
    np.testing.assert_array_equal(matrix, np.eye(4))
    np.testing.assert_array_equal(kept, range(4))


def test_what_only_a_sum_tells_is_lumped_into_the_part_before():
    row = np.array([1.0, 0.0, 2.0])  # of the first and the last, in units of what is known
    information = 1e6 * np.outer(row, row) + 1e6 * np.diag([0.0, 1.0, 0.0])
    matrix, kept = combinations(information)
    # the direction (2, 0, -1) is not told: its largest part is the first parameter
    np.testing.assert_array_equal(kept, [1, 2])
    np.testing.assert_allclose(matrix, [[0.0, 1.0, 0.0], [0.5, 0.0, 1.0]], atol=1e-9)
    np.testing.assert_allclose(matrix @ [2.0, 0.0, -1.0], 0.0, atol=1e-9)


def test_of_equal_parts_that_nearer_to_the_tips_is_lumped():
    row = np.array([1.0, 1.0])
    matrix, kept = combinations(1e6 * np.outer(row, row))
    np.testing.assert_array_equal(kept, [0])
    np.testing.assert_allclose(matrix, [[1.0, 1.0]], atol=1e-9)


def test_combinations_do_not_move_along_what_is_not_told():
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((3, 7)) * 1e3
    matrix, kept = combinations(rows.T @ rows)
    assert len(kept) == 3
    null = np.linalg.svd(rows)[2][3:]
    np.testing.assert_allclose(matrix @ null.T, 0.0, atol=1e-9)


def test_nothing_is_told_by_nothing():
    matrix, kept = combinations(np.zeros((3, 3)))
    assert matrix.shape == (0, 3) and len(kept) == 0


def test_of_a_lone_bus_that_only_turns_the_inertias_are_told():
    """Its centre is far from the origin: what is unseen has as large a part in them as in first moments."""
    theta = np.array([199.3, 0.4, 0.2, 60.4, 56.2, 1.2, 63.3, -0.9, 2.4, 22.0])
    width = np.array([100.0, 61.0, 61.0, 61.0, *6 * [37.25]])
    steps = np.diag(1e-6 * width)
    inertia = np.array([about_centre(theta + s) - about_centre(theta - s) for s in steps])[:, 3:] / 2e-6
    information = 1e4 * inertia @ inertia.T
    np.testing.assert_array_equal(combinations(information, range(4))[1], range(4, 10))
    assert 6 not in combinations(information)[1]  # the parts alone would have it told by the first moment


def test_what_a_push_tells_of_a_bus_is_not_lumped_into_an_inertia():
    unseen = np.zeros(10)
    unseen[[3, 4]] = 0.2, 1.0  # an axis about which nothing turned
    information = 1e6 * (np.eye(10) - np.outer(unseen, unseen) / (unseen @ unseen))
    np.testing.assert_array_equal(combinations(information, range(4))[1], [0, 1, 2, 3, *range(5, 10)])


def test_names_begin_with_their_own_parameter():
    assert combination_name(np.array([-2.0, 1.0, 1.0]), 1, ["a.m", "b.mx", "c.m"]) == "b.mx - 2 a.m + c.m"


def test_factors_have_the_digits_that_their_effect_asks_for():
    """And the name says them all: what is added up by the name is the value."""
    assert rounded_factor(0.123456789, 1.0) == 0.1235
    assert abs(rounded_factor(0.123456789, 1e-6) - 0.123456789) <= 1e-6
    factors = np.array([rounded_factor(-0.123456789, 1e-7), 1.0])
    assert combination_name(factors, 1, ["a.m", "b.m"]) == f"b.m - {-float(factors[0])!r} a.m"


def test_the_total_mass_is_the_sum_of_the_masses_that_are_reported():
    def row(name, unit, *gradient):
        return Combination(name, unit, 1.0, np.array(gradient), 1.0)

    total, tank = row("total.mass", "kg", 1, 1, 0), row("tank.mass", "kg", 0, 1, 0)
    bus, inertia = row("bus.m", "kg", 1, 0, 0), row("bus.Ixx", "kg m^2", 0, 0, 1)
    assert terms_of_total([total, tank, bus, inertia]) == ("tank.mass", "bus.m")
    assert terms_of_total([row("total.mass", "kg", 1, 0, 0), bus, inertia]) == ("bus.m",)
    assert terms_of_total([total, bus, inertia]) == terms_of_total([bus, inertia]) == ()


@pytest.mark.parametrize("robot", ["arm3", "double_pendulum", "ur5", "panda", "xarm7"])
def test_an_arm_has_the_base_parameters_of_its_torques(robot):
    """By the information of torques at random states, and by a QR decomposition of their regressor."""
    try:
        found = (
            arm_description(urdf_folder() / "arm3.urdf") if robot == "arm3" else arm_description(robot=robot)
        )
    except Exception as error:  # not installed, or another version of the robots
        pytest.skip(str(error))
    model, rng = rigid_arm(found), np.random.default_rng(1)
    regressor = Regressor(model)
    q = model.set_joint_angles(model.home, rng.uniform(-np.pi, np.pi, (200, len(model.arm_joints))))
    v, a = rng.normal(size=(2, 200, model.nv))
    bodies = regressor.parameters.reshape(-1, 10)
    width = 10.0 * np.maximum(np.concatenate([body_size(theta) for theta in bodies]), 1e-6)
    rows = regressor.torque(q, v, a).reshape(-1, len(width)) * width
    _, kept = combinations(1e6 * rows.T @ rows, (), width)
    assert kept.tolist() == sorted(i for i in structural_base(model).independent.tolist() if i < len(width))
