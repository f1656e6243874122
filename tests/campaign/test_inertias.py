"""Drawn inertias of links: physical always, of the spread asked for, and in the model of the case."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from smsid.campaign import load_campaign, prepare
from smsid.campaign._inertias import drawn_inertia
from smsid.effects.inertial_parameters import pseudo_inertia
from smsid.model import build_model

BODY = np.array([[3.0, 0.2, -0.1], [0.2, 4.0, 0.3], [-0.1, 0.3, 5.0]])


def parameters(mass: float, centre: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Ten parameters about the origin."""
    matrix = about + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    xx, xy, xz, yy, yz, zz = matrix[np.triu_indices(3)]
    return np.array([mass, *(mass * centre), xx, xy, yy, xz, yz, zz])


@pytest.mark.parametrize("relative", [0.01, 0.3, 1.0])
def test_any_draw_is_a_physical_body(relative: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        theta = parameters(*drawn_inertia(10.0, BODY, relative, rng))
        values = np.linalg.eigvalsh(pseudo_inertia(theta))
        assert values[0] > -1e-12 * values[-1]


def test_spread_is_the_one_asked_for() -> None:
    rng = np.random.default_rng(2)
    draws = [drawn_inertia(10.0, BODY, 0.02, rng) for _ in range(4000)]
    masses = np.array([m for m, _, _ in draws])
    assert masses.std() / 10.0 == pytest.approx(0.02, rel=0.05)
    assert masses.mean() == pytest.approx(10.0, rel=2e-3)
    second = 0.5 * np.trace(BODY) * np.eye(3) - BODY
    values, axes = np.linalg.eigh(second)
    centres = np.array([c for _, c, _ in draws]) @ axes
    assert np.allclose(centres.std(axis=0), 0.02 / np.sqrt(2) * np.sqrt(values / 10.0), rtol=0.06)


def test_a_thin_rod_stays_a_thin_rod() -> None:
    mass, centre, about = drawn_inertia(2.0, np.diag([0.0, 1.0, 1.0]), 0.3, np.random.default_rng(3))
    assert mass > 0.0
    assert np.allclose(np.linalg.eigvalsh(about)[0], 0.0, atol=1e-12)
    assert np.allclose(centre[1:], 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["paper_sms", "two_arm_sms"])
def test_the_case_flies_the_drawn_bodies(
    name: str, make_plan: Callable[..., Path], urdf: Path, tmp_path: Path
) -> None:
    """Guess and description keep theirs; on mounted arms too; the case's files are gone afterwards."""
    plan = make_plan(
        description=str(urdf / f"{name}.toml"), truth=[{"links": ["*"], "relative": 0.05}], method="paper"
    )
    prepared = prepare(load_campaign(plan))
    described = build_model(prepared.description)
    masses = []
    for run in (0, 0, 1):
        with prepared.case(run, tmp_path) as case:
            truth, guess = build_model(case.truth), build_model(case.guess)
            files = list(tmp_path.glob("smsid-campaign-*/truth/*.urdf"))
            assert files
        assert not any(f.exists() for f in files)
        assert guess.mass == described.mass
        masses.append([i.mass for i in truth.pin.inertias])
    arm = [i for i, n in enumerate(described.pin.names) if "joint" in n and "root" not in n]
    assert masses[0] == masses[1]
    assert all(masses[0][i] != masses[2][i] for i in arm)
    ratio = np.array([masses[0][i] / described.pin.inertias[i].mass for i in arm])
    assert np.all((ratio > 0.75) & (ratio < 1.3) & (ratio != 1.0))
    assert len(set(ratio)) == len(ratio)


def test_one_link_only(make_plan: Callable[..., Path], urdf: Path) -> None:
    plan = make_plan(
        description=str(urdf / "two_arm_sms.toml"),
        method="paper",
        truth=[{"links": ["left/*3"], "relative": 0.1}],
    )
    prepared = prepare(load_campaign(plan))
    described = build_model(prepared.description)
    with prepared.case(0) as case:
        truth = build_model(case.truth)
    changed = [
        n
        for n, a, b in zip(truth.pin.names, truth.pin.inertias, described.pin.inertias, strict=True)
        if a != b
    ]
    assert changed == ["left/joint3"]
