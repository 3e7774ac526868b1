"""Many robots and recordings: sessions side by side on this machine or on many, and what they tell together."""

from .dispatch import cores, spread
from .manifest import Entry, Manifest, read_manifest
from .order import Answer, Order
from .result import Fleet, Outcome
from .run import fleet

__all__ = ["Answer", "Entry", "Fleet", "Manifest", "Order", "Outcome", "cores", "fleet", "read_manifest", "spread"]
