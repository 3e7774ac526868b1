"""JSON without the numbers that only Python writes."""

from __future__ import annotations

import json
from typing import Any


def strict(text: str) -> Any:
    """JSON as every reader understands it."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)
