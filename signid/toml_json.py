"""Read TOML and JSON files; other text (not UTF-8, wrong syntax, nested too deeply) is a ValueError of one line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file."""
    return dict(_parsed(tomllib.loads, path))


def read_json(path: str | Path) -> Any:
    """Read a JSON file."""
    return _parsed(json.loads, path)


def _parsed(parse: Callable[[str], Any], path: str | Path) -> Any:
    text = Path(path).read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    try:
        return parse(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
