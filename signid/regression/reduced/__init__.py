"""Recordings as factors: all that identification needs of them, in a small file, cut into parts and added again."""

from ...recording.formats.npz import is_factor_file
from .add import add_up
from .file import encode_factors, load_factors
from .reduce import Reduced, reduce

__all__ = ["Reduced", "add_up", "encode_factors", "is_factor_file", "load_factors", "reduce"]
