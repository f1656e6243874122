"""Maximum likelihood as a campaign's method: truths of the drawn spacecraft, bodies that can exist."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from smsid.campaign import campaign_main, read_store
from smsid.campaign._identification import GROUP


def test_exp1_with_a_spacecraft_that_differs_from_its_description(
    make_plan: Callable[..., Path], tmp_path: Path
) -> None:
    plan = make_plan(
        file="ml.toml",
        method="ml",
        experiments=["exp1_x"],
        runs=1,
        truth=[{"parameters": ["tank.mass"], "relative": 0.1}, {"links": ["*"], "relative": 0.05}],
    )
    store = tmp_path / "ml.jsonl"
    summary = campaign_main(plan, store, backend="serial")
    assert not summary.failures
    (record,) = read_store(store)[1]
    found = {o.name: o for o in record.outcomes}
    for name in ("total.mass", "tank.mass", "tank.stiffness.x", "tank.damping.x"):
        outcome = found[name]
        assert outcome.truth is not None
        assert outcome.sigma is not None
        assert abs(outcome.value - outcome.truth) < 5.0 * outcome.sigma, name
    assert abs(found["total.mass"].truth / 2256.8 - 1.0) > 1e-4  # type: ignore[operator]
    bodies = [o for o in record.outcomes if o.group == GROUP]
    assert len(bodies) == 4
    assert all(o.value > 0.0 for o in bodies)
