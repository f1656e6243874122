"""Recordings: labelled channels with unit, frame and clock; reading, writing and importing them.

>>> rec = Recording.from_arrays([0.0, 0.1], {"imu.angular_rate": [[0, 0, 0.01], [0, 0, 0.02]]})
>>> rec.unit("imu.angular_rate")
'rad/s'
"""

from smsid.recording._clock import Gap
from smsid.recording.channels import QUANTITIES, Quantity, quantity_of
from smsid.recording.recording import Recording, Role
from smsid.recording.storage import load_recording, save_recording

__all__ = [
    "QUANTITIES",
    "Gap",
    "Quantity",
    "Recording",
    "Role",
    "load_recording",
    "quantity_of",
    "save_recording",
]
