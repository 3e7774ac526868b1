"""Recordings reduced to factors: a small file with all that identification needs; factors of parts can be added."""

from ...recording.formats.npz import is_factor_file
from .file import encode_factors, load_factors
from .reduce import Reduced, add_up, reduce

__all__ = ["Reduced", "add_up", "encode_factors", "is_factor_file", "load_factors", "reduce"]
