"""Public recordings of real hardware, by name: nothing of them is committed, no test downloads them.

Beside them the small demonstration that comes with the package, see `demonstration`.
"""

from smsid.datasets._fetch import DATASETS, DataFile, DataSet, data_set, fetch, have, sha256
from smsid.datasets._recordings import antisloshing, cessipy_slab, silverbox, tx40
from smsid.datasets.demonstration import Demonstration, demonstration

__all__ = [
    "DATASETS",
    "DataFile",
    "DataSet",
    "Demonstration",
    "antisloshing",
    "cessipy_slab",
    "data_set",
    "demonstration",
    "fetch",
    "have",
    "sha256",
    "silverbox",
    "tx40",
]
