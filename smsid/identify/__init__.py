"""Identification: estimators, from arrays to numbers with intervals.

`identify` takes a description and recordings of the paper's two experiments. Below it are its steps:
regressions of each experiment (`identify_axis`, `step_a`, `step_b`), modes (`panel_modes`, `ssi_cov`), total
least squares.
"""

from typing import TYPE_CHECKING

from smsid._callable import make_callable
from smsid._lazy import lazy_names

if TYPE_CHECKING:
    from smsid.identify.appendage_modes import PanelModes, panel_modes
    from smsid.identify.estimate import Estimate, ParameterEstimate, load_estimate, save_estimate
    from smsid.identify.modes import Mode, Poles, mac
    from smsid.identify.paper.combined import Agreement, Combined, combine
    from smsid.identify.paper.exp1 import identify_translation
    from smsid.identify.paper.exp1_result import TranslationResult
    from smsid.identify.paper.exp2 import MomentumResult, identify_momentum
    from smsid.identify.paper.hidden_states import HiddenStates
    from smsid.identify.paper.modal_state import ModalState, integrate_accelerometers, smooth_modes
    from smsid.identify.paper.momentum import StepA, step_a, step_b
    from smsid.identify.paper.momentum_printed import step_b_printed
    from smsid.identify.paper.momentum_regression import Regression
    from smsid.identify.paper.motion import Motion, prepare
    from smsid.identify.paper.pipeline import Identification, identify, with_translation
    from smsid.identify.paper.pose_point import PosePoint, refine_pose_point
    from smsid.identify.paper.recursive_tls import RecursiveTls
    from smsid.identify.paper.slosh_state import estimate_slosh
    from smsid.identify.paper.translation import AxisData, AxisEstimate, identify_axis
    from smsid.identify.ssi import ssi_cov
    from smsid.identify.ssi_input import ssi_cov_input
    from smsid.identify.tls import TlsSolution, total_least_squares

__all__ = [
    "Agreement",
    "AxisData",
    "AxisEstimate",
    "Combined",
    "Estimate",
    "HiddenStates",
    "Identification",
    "ModalState",
    "Mode",
    "MomentumResult",
    "Motion",
    "PanelModes",
    "ParameterEstimate",
    "Poles",
    "PosePoint",
    "RecursiveTls",
    "Regression",
    "StepA",
    "TlsSolution",
    "TranslationResult",
    "combine",
    "estimate_slosh",
    "identify",
    "identify_axis",
    "identify_momentum",
    "identify_translation",
    "integrate_accelerometers",
    "load_estimate",
    "mac",
    "panel_modes",
    "prepare",
    "refine_pose_point",
    "save_estimate",
    "smooth_modes",
    "ssi_cov",
    "ssi_cov_input",
    "step_a",
    "step_b",
    "step_b_printed",
    "total_least_squares",
    "with_translation",
]

make_callable(__name__)  # smsid.identify(...) is that of smsid.api
_, __getattr__ = lazy_names(__name__)
