"""Public recordings of real robots: sources, licences and downloads.

Nothing is downloaded automatically. Each data set is one module; other packages register theirs at the entry point
`signid.data`.
"""

from .base import DATA, DataSet, Product
from .download import DownloadLimits
from .fetch import check_source, fetch
from .place import data_folder, is_complete, recordings

__all__ = [
    "DATA",
    "DataSet",
    "DownloadLimits",
    "Product",
    "check_source",
    "data_folder",
    "fetch",
    "is_complete",
    "recordings",
]
