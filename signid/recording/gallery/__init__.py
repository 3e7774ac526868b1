"""Public recordings of real robots: where they are, under which licence, and how signid gets them.

Nothing is downloaded unless it is asked for. A data set is one file; other packages add theirs behind the entry point
`signid.data`.
"""

from .base import DATA, DataSet, Product
from .download import Patience
from .fetch import check_source, fetch
from .place import data_folder, is_complete, recordings

__all__ = [
    "DATA",
    "DataSet",
    "Patience",
    "Product",
    "check_source",
    "data_folder",
    "fetch",
    "is_complete",
    "recordings",
]
