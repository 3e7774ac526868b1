"""Public recordings of real robots: sources, licences and downloads.

Nothing is downloaded automatically. `sets` lists the data sets; other packages register theirs at the entry point
`signid.data`.
"""

from .download import DATA, DataSet, Product, check_source, data_folder, fetch, is_complete, recordings

__all__ = [
    "DATA",
    "DataSet",
    "Product",
    "check_source",
    "data_folder",
    "fetch",
    "is_complete",
    "recordings",
]
