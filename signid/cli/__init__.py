"""The command line: options go to the library, results are printed and written.

Each command is a short function whose parameters are its options; `signid COMMAND --help` lists them.
"""

from .run import main, run

__all__ = ["fleet", "main", "run"]
