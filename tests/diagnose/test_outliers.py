"""Outliers: found, told from what moves and from what is off throughout, and their share."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose._outliers import of_white_components, outlier_share, outliers, recount_outliers
from smsid.diagnose._sensor_faults import Fault


@pytest.fixture
def data(problem):
    return replace(problem.data, values=problem.data.values.copy(), sigma=problem.data.sigma.copy())


def test_outliers_are_found_and_a_channel_that_is_off_throughout_is_not(data):
    rng = np.random.default_rng(4)
    normalised = rng.standard_normal(data.values.shape)
    hit = rng.choice(len(data.times), 12, replace=False)
    normalised[hit, 2] = 20.0
    normalised[:, 5] *= 30.0
    run = SimpleNamespace(normalised=normalised, used=np.isfinite(data.values))
    (fault,) = outliers(data, run)
    assert fault.component == data.names[2]
    assert set(np.flatnonzero(fault.samples[:, 2])) == set(hit)


@pytest.mark.parametrize("size", [0.0, 6.5, 12.0])
def test_a_single_outlier_is_found_where_it_stands_out(data, size):
    rng = np.random.default_rng(5)
    normalised = rng.uniform(-2.0, 2.0, data.values.shape)
    row = data.names.index("encoder.joint_velocity[joint2]")
    normalised[300, row] = size
    run = SimpleNamespace(normalised=normalised, used=np.isfinite(data.values))
    found = outliers(data, run)
    if size > 7.0:
        (fault,) = found
        assert fault.component == data.names[row] and np.argwhere(fault.samples).tolist() == [[300, row]]
        assert fault.value == pytest.approx(1.0 / len(data.times))
    else:
        assert not found


def test_one_jump_is_no_outlier_where_the_motion_may_have_jumped(data):
    calm = np.zeros(data.values.shape)
    row = data.names.index("encoder.joint_velocity[joint2]")
    used = np.isfinite(data.values)

    def found(*there):
        normalised = calm.copy()
        for k, r, size in there:
            normalised[k, r] = size
        return outliers(data, SimpleNamespace(normalised=normalised, used=used))

    assert found((300, row, 12.0))
    assert not found((300, row, 12.0), (300, data.names.index("pose.velocity[x]"), -8.0))
    assert not found((300, row, 12.0), (301, row, 4.0))  # it lasts
    assert not found((300, data.names.index("imu.acceleration[y]"), 12.0))  # a jerk


@pytest.mark.parametrize("where", [0, 200, -1])
def test_one_reading_without_another_on_both_sides_is_no_outlier(data, where):
    normalised = np.zeros(data.values.shape)
    row = data.names.index("pose.velocity[x]")
    used = np.isfinite(data.values)
    used[:100, row] = False
    there = np.flatnonzero(used[:, row])
    normalised[there[where], row] = 12.0
    found = outliers(data, SimpleNamespace(normalised=normalised, used=used))
    assert len(found) == (where == 200)


@pytest.mark.parametrize("share", [0.01, 0.04])
@pytest.mark.parametrize("kind", ["student", "normal", "uniform"])
def test_the_share_counts_outliers_no_larger_than_noise(share, kind):
    """Two of the laws they are drawn from are none of those that are fitted. The peer counts those beyond six
    sigmas: the fitted share is biased by less than half as much, and its sigma holds what is left.
    """
    rng = np.random.default_rng(8)
    draw = {
        "student": lambda n: 12.0 * rng.standard_t(3, n),
        "normal": lambda n: 20.0 * rng.standard_normal(n),
        "uniform": lambda n: rng.uniform(-30.0, 30.0, n),
    }[kind]
    off, counting, marks = [], [], []
    for _ in range(40):
        hit = rng.uniform(size=1600) < share
        x = rng.standard_normal(1600)
        x[hit] += draw(int(hit.sum()))
        hits = int((np.abs(x) > 6.0).sum())
        found, sigma, among = outlier_share(x, hits)
        off.append((found - share) / sigma)
        counting.append((hits / 1600 - share) / sigma)
        marks.append((np.count_nonzero(among & ~hit), np.count_nonzero(among & hit) / np.count_nonzero(hit)))
    assert abs(np.mean(off)) < 0.5 * abs(np.mean(counting))
    assert np.mean(np.abs(off) < 3.0) > 0.95
    assert 0.7 < np.std(off) < 1.3
    wrong, right = np.mean(marks, axis=0)
    assert wrong < 2.0 and right > 0.75


@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("bias", [0.0, 8.0])
def test_the_share_is_that_of_readings_that_no_longer_pull_the_filter_along(data, noise, bias):
    """What a large outlier did to the next readings is none of them; whatever the noise is found to be, and
    where a bias that begins midway is known.
    """
    rng = np.random.default_rng(10)
    row = data.names.index("encoder.joint_position[joint2]")
    block = next(b for b in data.blocks if b.rows.start <= row < b.rows.stop)
    n, start = len(data.times), float(data.times[len(data.times) // 2])
    hit = rng.uniform(size=n) < 0.03
    size = noise * data.sigma
    predicted = rng.standard_normal(data.values.shape)
    normalised = rng.standard_normal(data.values.shape)
    late = bias * size[block.rows] * np.eye(block.rows.stop - block.rows.start)[row - block.rows.start]
    data.values[:] = predicted + normalised * size
    data.values[:, block.rows] += late * (data.times >= start)[:, None]
    data.values[hit, row] += 20.0 * size[row] * rng.standard_normal(int(hit.sum()))
    marked = np.zeros(data.values.shape, dtype=bool)
    marked[:, row] = hit | (rng.uniform(size=n) < 0.05)  # some that only followed one
    run = SimpleNamespace(normalised=normalised, errors=normalised * size, predicted=predicted, used=~marked)
    blocks = tuple(replace(b, later=((start, late),)) if b is block else b for b in data.blocks)
    problem = SimpleNamespace(data=replace(data.without(marked), sigma=size, blocks=blocks))
    first = Fault("outliers", block.channel, data.names[row], 0.08, 0.01, marked)
    (again,) = recount_outliers([first], data, problem, run)
    assert again.value == pytest.approx(hit.mean(), abs=3.0 * again.sigma)
    assert again.sigma < 0.01 and again.samples is marked


def test_what_a_fit_without_them_follows_is_no_outlier(data):
    rng = np.random.default_rng(11)
    row = data.names.index("encoder.joint_position[joint2]")
    predicted, normalised = rng.standard_normal((2, *data.values.shape))
    data.values[:] = predicted + normalised * data.sigma
    marked = np.zeros(data.values.shape, dtype=bool)
    marked[[100, 200, 300, 400], row] = True
    run = SimpleNamespace(
        normalised=normalised, errors=normalised * data.sigma, predicted=predicted, used=~marked
    )
    fault = Fault("outliers", "encoder.joint_position", data.names[row], 0.003, 0.001, marked)
    assert not recount_outliers([fault], data, SimpleNamespace(data=data.without(marked)), run)


def test_one_that_is_left_of_several_has_to_stand_alone(data):
    """Another encoder was off at the same sample: friction that turned over, and no outlier."""
    rng = np.random.default_rng(13)
    row, other = (data.names.index(f"encoder.joint_{x}]") for x in ("velocity[joint2", "position[joint3"))
    predicted, normalised = rng.standard_normal((2, *data.values.shape))
    normalised[:, row] = rng.uniform(-2.0, 2.0, len(normalised))
    data.values[:] = predicted + normalised * data.sigma
    data.values[300, row] += 12.0 * data.sigma[row]
    marked = np.zeros(data.values.shape, dtype=bool)
    marked[[100, 200, 300, 400], row] = True
    fault = Fault("outliers", "encoder.joint_velocity", data.names[row], 0.003, 0.001, marked)
    problem = SimpleNamespace(data=data.without(marked))
    for off, kept in ((0.0, 1), (-9.0, 0)):
        normalised[300, other] = off
        run = SimpleNamespace(
            normalised=normalised, errors=normalised * data.sigma, predicted=predicted, used=~marked
        )
        assert len(recount_outliers([fault], data, problem, run)) == kept


def test_readings_far_off_in_a_row_are_of_the_motion(data):
    """Where teeth cross a gap, each crossing is off for some samples. Outliers know nothing of each other, be
    one in ten of the readings such.
    """
    row, n = data.names.index("encoder.joint_position[joint2]"), len(data.times)
    lost = []
    for seed in range(20):
        rng = np.random.default_rng([seed, 3])

        def kept(hits, rng=rng):
            predicted, normalised = rng.standard_normal((2, *data.values.shape))
            data.values[:] = predicted + normalised * data.sigma
            data.values[hits, row] += 15.0 * data.sigma[row] * rng.choice([-1.0, 1.0], len(hits))
            marked = np.zeros(data.values.shape, dtype=bool)
            marked[hits, row] = True
            fault = Fault("outliers", "encoder.joint_position", data.names[row], 0.1, 0.01, marked)
            problem = SimpleNamespace(data=data.without(marked))
            run = SimpleNamespace(
                normalised=normalised, errors=normalised * data.sigma, predicted=predicted, used=~marked
            )
            return recount_outliers([fault], data, problem, run)

        lost.append(not kept(np.flatnonzero(rng.uniform(size=n) < (0.01 if seed % 2 else 0.1))))
        crossed = rng.choice(np.arange(1, n - 3, 3), 12, replace=False)
        assert not kept(np.concatenate([crossed, crossed + 1]))
    assert sum(lost) <= 1


def test_noise_with_heavy_tails_has_few_outliers_at_most():
    rng = np.random.default_rng(12)
    for _ in range(30):
        x = rng.standard_t(5, 1600) / np.sqrt(5.0 / 3.0)
        share, _, among = outlier_share(x, 3)
        assert share < 0.01 and among.sum() < 16


def test_too_few_to_tell_a_distribution_are_counted():
    x = np.random.default_rng(9).standard_normal(1000)
    x[[200, 500]] = 15.0, -12.0
    share, sigma, among = outlier_share(x, 2)
    assert share == 0.002 and sigma == pytest.approx(np.sqrt(0.002 * 0.998 / 1000)) and not among.any()


def test_outliers_are_no_fault_where_the_errors_are_not_white():
    """A panel of segments left three of its accelerometers' components behind, and one had "outliers"."""
    wild, other = (
        Fault(
            "outliers", "panel.acceleration", f"panel.acceleration[{k}.z]", 0.02, 0.01, np.zeros((1, 1), bool)
        )
        for k in (1, 2)
    )
    left = {"panel.acceleration[1.z]", "panel.acceleration"}
    assert of_white_components([wild, other], left) == [other]
    assert of_white_components([wild], set()) == [wild]
