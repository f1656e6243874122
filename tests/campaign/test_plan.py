"""Plans: what they draw, and what is refused before the first run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from smsid.campaign import load_campaign, prepare
from smsid.errors import DescriptionError, ExperimentError

Plan = Callable[..., Path]


def drawn(path: Path, runs: int, name: str, what: str = "truth") -> np.ndarray:
    """Values of a parameter over runs."""
    prepared = prepare(load_campaign(path))
    values = []
    for run in range(runs):
        with prepared.case(run) as case:
            effects = getattr(case, what).effect
            values.append(next(p.value for e in effects for p in e.parameters() if p.name == name))
    return np.array(values)


def test_generator_of_a_run_is_that_of_its_spawn_key(make_plan: Plan) -> None:
    campaign = load_campaign(make_plan())
    a, b = campaign.rng(3, "x").random(5), campaign.rng(3, "x").random(5)
    assert np.array_equal(a, b)
    others = [campaign.rng(4, "x"), campaign.rng(3, "y")]
    assert all(not np.array_equal(a, r.random(5)) for r in others)


def test_relative_draws_are_normal_about_the_description(make_plan: Plan) -> None:
    z = (drawn(make_plan(), 300, "tank.mass") / 49.6 - 1.0) / 0.1
    assert np.abs(z).max() <= 3.0
    assert stats.kstest(z, stats.truncnorm(-3, 3).cdf).pvalue > 1e-3


def test_range_is_uniform(make_plan: Plan) -> None:
    plan = make_plan(truth=[{"parameters": ["tank.mass"], "range": [40.0, 60.0]}])
    assert stats.kstest((drawn(plan, 300, "tank.mass") - 40.0) / 20.0, "uniform").pvalue > 1e-3


def test_together_keeps_an_isotropic_tank_isotropic(make_plan: Plan) -> None:
    table = {"parameters": ["tank.stiffness.*"], "relative": 0.2, "together": True}
    plan = make_plan(truth=[table])
    x, y = (drawn(plan, 5, f"tank.stiffness.{a}") for a in "xy")
    assert np.array_equal(x, y)
    plan = make_plan(truth=[{**table, "together": False}])
    x, y = (drawn(plan, 5, f"tank.stiffness.{a}") for a in "xy")
    assert not np.any(x == y)


def test_draws_stay_within_the_bounds_of_the_parameter(make_plan: Plan) -> None:
    plan = make_plan(truth=[{"parameters": ["tank.damping.x"], "sigma": 0.05}])
    assert drawn(plan, 50, "tank.damping.x").min() >= 0.0


def test_one_draw_does_not_depend_on_what_else_is_varied(make_plan: Plan) -> None:
    alone = drawn(make_plan(), 3, "tank.mass")
    more = make_plan(
        truth=[
            {"parameters": ["tank.damping.x"], "relative": 0.1},
            {"parameters": ["tank.mass"], "relative": 0.1},
        ]
    )
    assert np.array_equal(alone, drawn(more, 3, "tank.mass"))


def test_guess_is_drawn_apart_from_the_truth(make_plan: Plan) -> None:
    plan = make_plan(guess=[{"parameters": ["tank.mass"], "relative": 0.1}])
    assert not np.any(drawn(plan, 4, "tank.mass") == drawn(plan, 4, "tank.mass", "guess"))
    assert np.all(drawn(make_plan(), 4, "tank.mass", "guess") == 49.6)


def test_noise_scales_random_errors_of_the_truth_only(make_plan: Plan) -> None:
    plan = make_plan(noise={"scale": 3.0, "sensors": {"imu": [1.0, 2.0]}})
    prepared = prepare(load_campaign(plan))
    for run in range(3):
        with prepared.case(run) as case:
            for sensor, described in zip(case.truth.sensor, case.description.sensor, strict=True):
                for quantity, model in sensor.errors.items():
                    ratio = model.white_sigma(100.0) / described.error(quantity).white_sigma(100.0)
                    assert (
                        np.all((ratio >= 3.0) & (ratio <= 6.0))
                        if sensor.name == "imu"
                        else np.all(ratio == 3.0)
                    )
            assert case.guess.sensor == case.description.sensor
    known = prepare(load_campaign(make_plan(noise={"scale": 3.0, "known": True})))
    with known.case(0) as case:
        assert case.guess.sensor == case.truth.sensor


def test_fixed_noise_seed_gives_every_run_the_same_noise(make_plan: Plan) -> None:
    fixed = prepare(load_campaign(make_plan(noise={"seed": 5})))
    own = prepare(load_campaign(make_plan()))
    for prepared, same in ((fixed, True), (own, False)):
        first, second = [], []
        for run, out in ((0, first), (1, second)):
            with prepared.case(run) as case:
                out.append(case.sensor_rng(0).random())
        assert (first == second) is same


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"runs": 0}, "runs"),
        ({"seed": -1}, "seed"),
        ({"sead": 1}, "did you mean 'seed'"),
        ({"truth": [{"parameters": ["tank.mass"]}]}, "give one of"),
        ({"truth": [{"links": ["base"], "sigma": 1.0}]}, "relative"),
        ({"truth": [{"relative": 0.1}]}, "give `parameters` or `links`"),
        ({"truth": [{"parameters": ["tank.mas"], "relative": 0.1}]}, "Did you mean 'tank.mass'"),
        ({"truth": [{"links": ["elbow"], "relative": 0.1}]}, "no link with mass 'elbow'"),
        ({"truth": [{"parameters": ["tank.*", "tank.mass"], "range": [-1.0, 1.0]}]}, "bounds"),
        ({"truth": [{"parameters": ["tank.mass"], "sigma": 1.0}] * 2}, "drawn twice"),
        ({"noise": {"scale": [2.0, 1.0]}}, "wrong way round"),
        ({"noise": {"sensors": {"imo": 2.0}}}, "Did you mean 'imu'"),
        ({"experiments": ["exp3"]}, "There is no experiment"),
        ({"experiments": ["exp1", "exp1"]}, "twice"),
        ({"method": "papre"}, "Did you mean 'paper'"),
        ({"method": "no_module:run"}, "cannot be imported"),
        ({"method": "cheap_method:mesure"}, "Did you mean 'measure'"),
        ({"options": {"paus": 1.0}}, "pause"),
        ({"options": {"pause": "long"}}, "Option `pause`"),
    ],
)
def test_bad_plans_are_refused_before_the_first_run(make_plan: Plan, keys: dict, words: str) -> None:
    with pytest.raises(ExperimentError) as caught:
        prepare(load_campaign(make_plan(**keys)))
    assert words in str(caught.value)


def test_missing_files_and_bad_toml_are_named(make_plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"nowhere\.toml"):
        prepare(load_campaign(make_plan(description="nowhere.toml")))
    with pytest.raises(ExperimentError, match="does not exist"):
        load_campaign(tmp_path / "none.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("name = [")
    with pytest.raises(ExperimentError, match="not valid TOML"):
        load_campaign(broken)


def test_example_is_a_good_plan(urdf: Path) -> None:
    prepared = prepare(load_campaign(urdf.parent / "examples" / "campaign_paper.toml"))
    assert prepared.campaign.runs == 20
