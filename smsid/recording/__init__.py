"""Recordings: labelled channels with unit, frame and clock; reading, writing and importing them.

>>> rec = Recording.from_arrays([0.0, 0.1], {"imu.angular_rate": [[0, 0, 0.01], [0, 0, 0.02]]})
>>> rec.unit("imu.angular_rate")
'rad/s'
"""

from typing import TYPE_CHECKING

from smsid._lazy import lazy_names

if TYPE_CHECKING:
    from smsid.recording._importing import import_recording
    from smsid.recording.channels import QUANTITIES, quantity_of
    from smsid.recording.mapping import ImportMapping, bundled_mappings, load_mapping
    from smsid.recording.pieces import complete_pieces
    from smsid.recording.readers import CsvFormat, read_columns
    from smsid.recording.recording import Recording, Role
    from smsid.recording.storage import load_recording, save_recording

__all__ = [
    "QUANTITIES",
    "CsvFormat",
    "ImportMapping",
    "Recording",
    "Role",
    "bundled_mappings",
    "complete_pieces",
    "import_recording",
    "load_mapping",
    "load_recording",
    "quantity_of",
    "read_columns",
    "save_recording",
]

_, __getattr__ = lazy_names(__name__)
