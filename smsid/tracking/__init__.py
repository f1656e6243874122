"""On-line estimation: an extended Kalman filter with chosen parameters in its state, and recursive TLS.

Samples in, parameters and how well each is known out.
"""

from smsid.tracking._change_detection import Change, ChangeDetector
from smsid.tracking._momentum_tracker import MomentumTracker
from smsid.tracking._prediction import StatePrediction
from smsid.tracking._sample import Sample
from smsid.tracking._setting import Setting
from smsid.tracking._tracker import Tracker
from smsid.tracking._update import Update
from smsid.tracking.followed_parameters import Followed, followed_parameters
from smsid.tracking.history import TrackHistory, load_history, save_history
from smsid.tracking.stream import Stream
from smsid.tracking.track_momentum import track_momentum
from smsid.tracking.track_recordings import track_recordings
from smsid.tracking.tracker_file import load_tracker, save_tracker

__all__ = [
    "Change",
    "ChangeDetector",
    "Followed",
    "MomentumTracker",
    "Sample",
    "Setting",
    "StatePrediction",
    "Stream",
    "TrackHistory",
    "Tracker",
    "Update",
    "followed_parameters",
    "load_history",
    "load_tracker",
    "save_history",
    "save_tracker",
    "track_momentum",
    "track_recordings",
]
