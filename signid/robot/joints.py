"""Look up joints by name or number."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

from ..errors import RobotError, shorten


def find(given: str | int, names: Sequence[str], numbers: Sequence[int], robot: str) -> int:
    """Index in `names` of a joint given by its name or, if no joint has that name, by its number.

    Raises:
        RobotError: no moving joint has that name or number.
    """
    text = str(given)
    if text in names:
        return names.index(text)
    if text.isascii() and text.isdigit() and int(text) in numbers:
        return numbers.index(int(text))
    close = get_close_matches(text, names, n=3, cutoff=0.6)
    advice = f"did you mean {' or '.join(close)}?" if close else f"choose from {shorten(names)}"
    raise RobotError(f"{robot} has no joint {text!r} that moves by itself; {advice}")
