"""The command line: what is asked for goes to the library, what it finds is printed and written.

Each command is a function of a few lines, whose arguments are the options; `signid COMMAND --help` shows them.
"""

from .run import main, run

__all__ = ["fleet", "main", "run"]
