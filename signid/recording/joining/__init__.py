"""Logs that come as several files, one a joint or a quantity, each with its own clock: join them on time."""

from .files import Files, JoinedFile
from .join import Joined, open_files

__all__ = ["Files", "Joined", "JoinedFile", "open_files"]
