"""Fleets of robots: sessions run in parallel on one or several machines, and their joint evaluation."""

import sys
from typing import TYPE_CHECKING

from ...registry import inner_package as _package, public_names as _names

if TYPE_CHECKING:
    from .dispatch import cores as cores, spread as spread
    from .manifest import Entry as Entry, Manifest as Manifest, read_manifest as read_manifest
    from .process import Answer as Answer, Order as Order
    from .result import Fleet as Fleet, Outcome as Outcome
    from .run import fleet as fleet

NAMES = _names(__name__)

sys.modules[__name__].__class__ = _package(__name__, NAMES)
