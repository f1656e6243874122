"""One real campaign, small: Exp. 1 along x, with the paper's method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from campaign.conftest import lines_of
from smsid.campaign import campaign_main, load_campaign, prepare, read_store
from smsid.model import build_model


def test_exp1_with_a_spacecraft_that_differs_from_its_description(
    make_plan: Callable[..., Path], tmp_path: Path
) -> None:
    """Truths are those of the drawn spacecraft, and the estimates find them, not the description."""
    plan = make_plan(
        file="real.toml",
        method="paper",
        experiments=["exp1_x"],
        runs=2,
        truth=[{"parameters": ["tank.mass"], "relative": 0.2}, {"links": ["*"], "relative": 0.05}],
    )
    store = tmp_path / "real.jsonl"
    summary = campaign_main(plan, store, workers=2)
    assert not summary.failures
    prepared = prepare(load_campaign(plan))
    for record in read_store(store)[1]:
        found = {o.name: o for o in record.outcomes}
        with prepared.case(record.run) as case:
            truth = build_model(case.truth)
        mass = found["total.mass"]
        assert mass.truth == truth.mass
        assert abs(truth.mass / 2256.8 - 1.0) > 1e-3
        for outcome in (mass, found["tank.mass"], found["tank.stiffness.x"]):
            assert outcome.truth is not None
            assert outcome.sigma is not None
            assert abs(outcome.value - outcome.truth) < 6.0 * outcome.sigma
    again = tmp_path / "again.jsonl"
    campaign_main(plan, again, backend="serial", runs=1)
    assert lines_of(again)[0] == lines_of(store)[0]
