"""Using the result elsewhere: URDF, TOML, CSV and MuJoCo XML of an identified spacecraft or arm."""

from smsid._callable import make_callable
from smsid.export.bodies import IdentifiedBodies, identified_bodies
from smsid.export.estimate_values import with_estimate
from smsid.export.folder import Export, export_folder
from smsid.export.mjcf import write_mjcf

__all__ = [
    "Export",
    "IdentifiedBodies",
    "export_folder",
    "identified_bodies",
    "with_estimate",
    "write_mjcf",
]

make_callable(__name__)  # smsid.export(...) is that of smsid.api
