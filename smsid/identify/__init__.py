"""Identification: estimators, from arrays to numbers with intervals.

`identify` takes a description and recordings of the paper's two experiments. Below it are its steps:
regressions of each experiment (`identify_translation`, `step_a`, `step_b`), modes (`panel_modes`, `ssi_cov`),
total least squares.
"""

from typing import TYPE_CHECKING

from smsid._callable import make_callable
from smsid._lazy import lazy_names

if TYPE_CHECKING:
    from smsid.identify._tls import total_least_squares
    from smsid.identify.appendage_modes import panel_modes
    from smsid.identify.estimate import Estimate, ParameterEstimate, load_estimate, save_estimate
    from smsid.identify.paper.combined import combine
    from smsid.identify.paper.exp1 import identify_translation
    from smsid.identify.paper.modal_state import integrate_accelerometers, smooth_modes
    from smsid.identify.paper.momentum import step_a, step_b
    from smsid.identify.paper.pipeline import Identification, identify
    from smsid.identify.paper.slosh_state import estimate_slosh
    from smsid.identify.ssi import ssi_cov

__all__ = [
    "Estimate",
    "Identification",
    "ParameterEstimate",
    "combine",
    "estimate_slosh",
    "identify",
    "identify_translation",
    "integrate_accelerometers",
    "load_estimate",
    "panel_modes",
    "save_estimate",
    "smooth_modes",
    "ssi_cov",
    "step_a",
    "step_b",
    "total_least_squares",
]

make_callable(__name__)  # smsid.identify(...) is that of smsid.api
_, __getattr__ = lazy_names(__name__)
