"""An identified spacecraft or arm for other programs: URDF, TOML, CSV, MuJoCo XML, linear plant, FMU."""

from smsid._callable import make_callable
from smsid.export.bodies import IdentifiedBodies, identified_bodies, with_estimate
from smsid.export.fmu import write_fmu
from smsid.export.folder import Export, export_folder
from smsid.export.linear_plant import LinearPlant, linear_plant, save_linear_plant
from smsid.export.mjcf import write_mjcf

__all__ = [
    "Export",
    "IdentifiedBodies",
    "LinearPlant",
    "export_folder",
    "identified_bodies",
    "linear_plant",
    "save_linear_plant",
    "with_estimate",
    "write_fmu",
    "write_mjcf",
]

make_callable(__name__)  # smsid.export(...) is that of smsid.api
