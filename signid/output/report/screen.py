"""Where results are shown."""

from __future__ import annotations

import os
import sys

from rich.console import Console

PIPED = 100  # columns where there is no terminal to ask


class Screen(Console):
    """Standard output as it is when called: no colour codes where it is no terminal, brackets stay brackets."""

    def __init__(self) -> None:
        if hasattr(sys.stdout, "reconfigure"):
            sys.stdout.reconfigure(errors="replace")  # where "±" cannot be written
        known = sys.stdout.isatty() or "COLUMNS" in os.environ
        super().__init__(markup=False, highlight=False, emoji=False, width=None if known else PIPED)

    def write(self, text: str) -> None:
        """Text as it stands: neither wrapped nor coloured."""
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except BrokenPipeError:
            self.on_broken_pipe()

    def on_broken_pipe(self) -> None:
        """Go on in silence: a reader that has seen enough is no error."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
