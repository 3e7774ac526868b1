"""Results as terminal tables, JSON documents and HTML pages; files are written atomically."""

import sys
from typing import TYPE_CHECKING

from ...registry import inner_package as _package, public_names as _names

if TYPE_CHECKING:
    from .documents import document as document, page as page, report as report, tables as tables, to_json as to_json
    from .layout import Screen as Screen, figure as figure, with_interval as with_interval
    from .write import (
        WRITTEN as WRITTEN,
        Content as Content,
        check_foreign as check_foreign,
        check_regular as check_regular,
        probe_folder as probe_folder,
        write_files as write_files,
    )

NAMES = _names(__name__)

sys.modules[__name__].__class__ = _package(__name__, NAMES)
