"""Public recordings of real hardware, by name; nothing is committed and nothing is downloaded by tests."""

from smsid.datasets.fetch import fetch, have, sha256
from smsid.datasets.recordings import antisloshing, cessipy_slab, silverbox, tx40
from smsid.datasets.registry import DATASETS, DataFile, DataSet, data_set

__all__ = [
    "DATASETS",
    "DataFile",
    "DataSet",
    "antisloshing",
    "cessipy_slab",
    "data_set",
    "fetch",
    "have",
    "sha256",
    "silverbox",
    "tx40",
]
