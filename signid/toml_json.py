"""TOML and JSON text -> plain objects; whatever is wrong with the text is a ValueError of one line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any


def read_toml(path: str | Path) -> dict[str, Any]:
    """The table in a TOML file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not UTF-8 (a UnicodeDecodeError), not TOML, or nested without end.
    """
    return dict(_parsed(tomllib.loads, path))


def read_json(path: str | Path) -> Any:
    """What a JSON file holds.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not UTF-8 (a UnicodeDecodeError), not JSON, or nested without end.
    """
    return _parsed(json.loads, path)


def _parsed(parse: Callable[[str], Any], path: str | Path) -> Any:
    text = Path(path).read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    try:
        return parse(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
