"""The Cramer-Rao bound against numbers derived elsewhere, and against the refinement's own covariance."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import ExperimentError
from smsid.experiments.excitation import thrust_experiment
from smsid.likelihood import fisher_information, refine
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.sensing import Sensor

from . import twin
from .test_refine import off


def only(*kinds: str) -> list[Sensor]:
    return [s for s in twin.description().sensor if s.kind in kinds]


def two_masses(dt: float = 1e-3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bus and slosh mass on a line under (48), 120 s: time, acceleration and position of the bus with their
    derivatives by (M, m_s, k, b): (N, 5) each, by complex step in a closed form of the modal response."""
    t = np.arange(0.0, 120.0 + dt / 2, 0.01)

    def response(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        total, m, k, b = p
        # relative motion: rho'' + (k rho + b rho') / mu = -f / m_r, m_r = M - m_s, mu = m m_r / M
        rest = total - m
        mu = m * rest / total
        root = np.sqrt((b / (2 * mu)) ** 2 - k / mu + 0j)
        s1, s2 = -b / (2 * mu) + root, -b / (2 * mu) - root
        a, x = np.zeros(len(t), complex), np.zeros(len(t), complex)
        for start, size in ((0.0, 40.0), (20.0, -80.0), (40.0, 40.0)):
            tau = np.maximum(t - start, 0.0)
            on = t >= start - 1e-9
            # step response of rho, its rate and acceleration
            free = -size / rest * mu / k
            c1, c2 = -free * s2 / (s2 - s1), free * s1 / (s2 - s1)
            rho = free + c1 * np.exp(s1 * tau) + c2 * np.exp(s2 * tau)
            rate2 = c1 * s1**2 * np.exp(s1 * tau) + c2 * s2**2 * np.exp(s2 * tau)
            # the centre of mass feels the force alone: x = F t^2 / 2M - m rho / M
            x += on * (size * tau**2 / 2 / total - m / total * rho)
            a += on * (size / total - m / total * rate2)
        return a, x

    p = np.array([2256.8, 49.6, 0.41, 0.02], complex)
    columns = [[], []]
    for i in range(4):
        h = 1e-5 * p[i].real
        up, down = response(p + h * np.eye(4)[i]), response(p - h * np.eye(4)[i])
        for out, hi, lo in zip(columns, up, down, strict=True):
            out.append(((hi - lo) / (2 * h)).real)
    return t, np.array(columns[0]).T, np.array(columns[1]).T


def test_damping_of_the_slosh_as_derived_by_hand():
    """b_s from (48): 24 % with the accelerometer alone, 2.6 % with its position too (design's errata)."""
    _, acceleration, position = two_masses()
    constant = np.ones((len(acceleration), 1))
    zero = np.zeros_like(constant)
    from_acceleration = np.hstack([acceleration, constant]) / 1e-4
    information = from_acceleration.T @ from_acceleration
    alone = np.sqrt(np.linalg.inv(information)[3, 3]) / 0.02
    both = np.vstack(
        [np.hstack([acceleration, constant, zero]) / 1e-4, np.hstack([position, zero, constant]) / 1e-3]
    )
    with_position = np.sqrt(np.linalg.inv(both.T @ both)[3, 3]) / 0.02
    assert alone == pytest.approx(0.24, abs=0.005)
    assert with_position == pytest.approx(0.026, abs=0.001)

    pose = Sensor(
        name="pose",
        kind="pose",
        rate=100.0,
        position=(0.5, 1.5, 0.6),
        quantities=("position",),
        errors={"position": {"noise_sigma": 1e-3}},  # type: ignore[dict-item]
    )
    flown = thrust_experiment("x")
    found = fisher_information(twin.description(), flown, only("imu")).relative_sigma["tank.damping.x"]
    assert found == pytest.approx(alone, rel=0.01)
    found = fisher_information(twin.description(), flown, [*only("imu"), pose]).relative_sigma[
        "tank.damping.x"
    ]
    assert found == pytest.approx(with_position, rel=0.01)


def test_unseen_parameters_are_the_priors():
    bound = fisher_information(twin.description(), thrust_experiment("x"), only("imu"))
    share = dict(zip(bound.names, bound.prior_share, strict=True))
    assert share["tank.stiffness.y"] == pytest.approx(1.0)
    assert share["tank.stiffness.x"] < 1e-4


def test_longer_records_know_more():
    bounds = [
        fisher_information(twin.description(), thrust_experiment("x", duration=t)).sigma
        for t in (60.0, 120.0)
    ]
    for name in ("total.mass", "tank.mass", "tank.stiffness.x", "tank.damping.x"):
        assert bounds[1][name] < bounds[0][name]


def test_bound_is_what_the_refinement_predicts():
    clean = twin.exp1((1, 1, 1), 60.0)
    bound = fisher_information(twin.description(), clean).sigma
    found = refine(twin.description(), [twin.noisy(clean, 3)]).estimate
    for name, sigma in bound.items():
        # noise levels from 6001 samples are good to 1 %, and the bound is taken at slightly other values
        assert found[name].sigma == pytest.approx(sigma, rel=0.05), name


def test_sensors_without_noise_have_no_bound():
    perfect = Sensor(name="imu", kind="imu", rate=100.0)
    with pytest.raises(ExperimentError, match="without noise"):
        fisher_information(twin.description(), thrust_experiment("x"), [perfect])


def test_what_one_axis_does_not_show_does_not_widen_the_total_mass():
    """Along x the panel is only a mass: the data see the sum, to the last digit, whatever step came last."""
    flown = twin.exp1((1, 0, 0), 60.0)
    sensors = only("imu", "pose")
    start = refine(off(0.1).with_sensors(*sensors), [twin.noisy(flown, 0)])  # its panel is heavier
    found = refine(off().with_sensors(*sensors), [twin.noisy(flown, 1)], start)
    bound = fisher_information(twin.description(), flown, sensors).sigma["total.mass"]
    assert found.estimate["total.mass"].sigma == pytest.approx(bound, rel=0.03)
    at = found.fit.point.parameters
    bus, panel = at.names.index("bus.m"), at.names.index("panel.density_factor")
    masses = at.theta_jacobian()[::SIZE].sum(axis=0)
    seen = found.fit.normal.data[bus, [bus, panel]]
    assert seen[1] / seen[0] == pytest.approx(masses[panel] / masses[bus], rel=1e-9)
