"""Demonstration: record a robot whose simulation lacks physics, diagnose it and verify the result."""

import sys
from typing import TYPE_CHECKING

from ...registry import inner_package as _package, public_names as _names

if TYPE_CHECKING:
    from .document import story_document as story_document
    from .run import Story as Story, demo as demo
    from .words import by_hand as by_hand, story_end as story_end, story_tables as story_tables

NAMES = _names(__name__)

sys.modules[__name__].__class__ = _package(__name__, NAMES)
