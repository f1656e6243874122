"""A description that nothing can mend ends the search soon, with what is left; no clock is blamed."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.estimation._batch_check import channels_left
from smsid.likelihood import refine
from smsid.likelihood.fit import ConvergenceError
from smsid.likelihood.search import PATIENCE

from . import twin


def test_a_panel_half_as_long_again_stops_the_search():
    """It was searched for minutes, clock after clock, or ended in an error of numpy's."""
    panel = twin.description().get_effect("panel")
    longer = twin.description().with_effects(panel.model_copy(update={"length": 9.0}))
    recording = twin.noisy(twin.exp2(30.0), 0)
    with pytest.raises(ConvergenceError) as raised:
        refine(longer, [recording])
    error = raised.value
    assert len(error.visits) <= PATIENCE
    assert not any(
        "clock" in s.kind for p in error.pieces for s in p.slots if s.channel in ("imu", "pose", "panel")
    )
    ratios = {c.channel: c.ratio for c in channels_left(error.pieces, error.seen.residuals)}
    assert ratios["panel.acceleration"] > 10.0
    assert np.isfinite(list(ratios.values())).all()
