"""On-line estimation: an extended Kalman filter with chosen parameters in its state."""

from smsid.tracking.followed_parameters import Followed, followed_parameters
from smsid.tracking.sample import Sample
from smsid.tracking.setting import Setting
from smsid.tracking.track_recordings import track_recordings
from smsid.tracking.tracker import Prediction, Tracker, Update
from smsid.tracking.tracker_file import load_tracker, save_tracker

__all__ = [
    "Followed",
    "Prediction",
    "Sample",
    "Setting",
    "Tracker",
    "Update",
    "followed_parameters",
    "load_tracker",
    "save_tracker",
    "track_recordings",
]
