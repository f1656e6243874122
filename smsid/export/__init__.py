"""An identified spacecraft or arm for other programs: URDF, TOML, CSV, MuJoCo XML, linear plant, FMU."""

from smsid._callable import make_callable
from smsid.estimation.bodies import with_estimate
from smsid.export._mjcf import write_mjcf
from smsid.export.folder import Export, export_folder
from smsid.export.linear_plant import linear_plant

__all__ = [
    "Export",
    "export_folder",
    "linear_plant",
    "with_estimate",
    "write_mjcf",
]

make_callable(__name__)  # smsid.export(...) is that of smsid.api
