"""Public recordings of real robots: sources, licences and downloads.

Nothing is downloaded automatically. `sets` lists the data sets; other packages register theirs at the entry point
`signid.data`.
"""

from .download import (
    DATA as DATA,
    DataSet as DataSet,
    Product as Product,
    check_source as check_source,
    data_folder as data_folder,
    fetch as fetch,
    is_complete as is_complete,
    recordings as recordings,
)
