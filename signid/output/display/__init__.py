"""Results in a Python session: repr, HTML in notebooks, tables by name, saved models."""

import sys
from typing import TYPE_CHECKING

from ...registry import inner_package as _package, public_names as _names

if TYPE_CHECKING:
    from .frames import frame as frame
    from .save import save_model as save_model
    from .text import html as html, text as text

NAMES = _names(__name__)

sys.modules[__name__].__class__ = _package(__name__, NAMES)
