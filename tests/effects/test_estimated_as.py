"""Every effect in the parameters that the likelihood takes: it says the same, and is found again."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.effects import BeamAppendage, ModalAppendage, catalogue
from smsid.estimation.panels import modal_panels, plain_panels
from smsid.model import build_model
from tests.effects.test_catalogue import example
from tests.effects.test_strength import NOT_SIMULATED, paper


@pytest.mark.parametrize("kind", sorted(set(catalogue()) - set(NOT_SIMULATED)))
def test_every_effect_moves_the_craft_as_it_did_in_estimated_parameters(kind: str) -> None:
    """Also beside a beam that is estimated by its modes, where the effect takes no beam."""
    effect = example(kind)
    described = paper()[0].with_effects(effect)
    estimated, _ = modal_panels(described)
    readable = plain_panels(estimated)
    rng = np.random.default_rng(1)
    model = build_model(described)
    v = 0.1 * rng.standard_normal(model.nv)
    wanted = model.acceleration(20.0, model.home, v, np.zeros(model.nv))
    for other in (estimated, readable):
        again = build_model(other)
        found = again.acceleration(20.0, again.home, v, np.zeros(model.nv))
        np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("kind", sorted(k for k, c in catalogue().items() if c.needs_beam))
def test_a_beam_that_an_effect_needs_stays_one(kind: str) -> None:
    craft = paper()[0]
    assert isinstance(modal_panels(craft)[0].get_effect("panel"), ModalAppendage)
    kept, stands_for = modal_panels(craft.with_effects(example(kind)))
    assert isinstance(kept.get_effect("panel"), BeamAppendage) and not stands_for
