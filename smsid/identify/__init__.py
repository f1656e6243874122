"""Identification: estimators, from arrays to numbers with intervals.

`identify` takes a description and recordings of the paper's two experiments. Below it are its steps:
regressions of each experiment (`identify_axis`, `step_a`, `step_b`), modes (`panel_modes`, `ssi_cov`), total
least squares.
"""

from smsid._callable import make_callable
from smsid.identify.combined import Agreement, Combined, combine
from smsid.identify.estimate import Estimate, ParameterEstimate, load_estimate, save_estimate
from smsid.identify.exp1 import identify_translation
from smsid.identify.exp1_result import TranslationResult
from smsid.identify.exp2 import MomentumResult, identify_momentum
from smsid.identify.hidden_states import HiddenStates
from smsid.identify.modal_state import ModalState, integrate_accelerometers, smooth_modes
from smsid.identify.modes import Mode, Poles, mac
from smsid.identify.momentum import StepA, step_a, step_b
from smsid.identify.momentum_printed import step_b_printed
from smsid.identify.momentum_regression import Regression
from smsid.identify.motion import Motion, prepare
from smsid.identify.panel_modes import PanelModes, panel_modes
from smsid.identify.pipeline import Identification, identify, with_translation
from smsid.identify.pose_point import PosePoint, refine_pose_point
from smsid.identify.recursive_tls import RecursiveTls
from smsid.identify.slosh_state import estimate_slosh
from smsid.identify.ssi import ssi_cov
from smsid.identify.ssi_input import ssi_cov_input
from smsid.identify.tls import TlsSolution, total_least_squares
from smsid.identify.translation import AxisData, AxisEstimate, identify_axis

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
