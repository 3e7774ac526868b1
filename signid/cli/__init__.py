"""The command line: what is asked for goes to the library, what it finds is printed and written."""

from .run import main, run

__all__ = ["main", "run"]
