"""Read TOML and JSON files; every fault (not UTF-8, wrong syntax, too large ...) is a ValueError of one line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

SCHEMAS = Path(__file__).parent / "output" / "schema"
LARGEST_FILE = 200_000_000  # [bytes]
MAX_PARSED_NUMBER = 1e12  # magnitude of a number; no robot has a larger one in SI units


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file."""
    return dict(_parsed(tomllib.loads, path))


def read_json(path: str | Path) -> Any:
    """Read a JSON file."""
    return _parsed(json.loads, path)


def check_schema(content: Any, name: str) -> None:
    """Check the content of a file against `output/schema/NAME.json`, and that its numbers are finite.

    Raises:
        ValueError: the content is malformed; the message says where and why.
    """
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    schema = json.loads((SCHEMAS / f"{name}.json").read_text("utf-8"))
    if error := best_match(Draft202012Validator(schema).iter_errors(content)):
        text = " ".join(error.message.split())
        short = text if len(text) <= 100 else f"{text[:45]} ... {text[-45:]}"
        raise ValueError(f"{error.json_path[2:] or 'its content'}: {short}")
    check_numbers(content)


def check_numbers(content: Any) -> None:
    """Check that the numbers of a file's content are finite and not absurd.

    Raises:
        ValueError: one is not; the message says where.
    """
    for place, number in _numbers(content, ""):
        if not -MAX_PARSED_NUMBER <= number <= MAX_PARSED_NUMBER:
            raise ValueError(f"{place[1:]}: expected a finite number up to {MAX_PARSED_NUMBER:.0e}")


def _numbers(content: Any, place: str) -> Iterator[tuple[str, float]]:
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _numbers(value, f"{place}.{key}")
    elif isinstance(content, list):
        for k, value in enumerate(content):
            yield from _numbers(value, f"{place}[{k}]")
    elif isinstance(content, int | float):
        yield place, content


def _parsed(parse: Callable[[str], Any], path: str | Path) -> Any:
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ValueError("it is no regular file")
    if path.exists() and path.stat().st_size > LARGEST_FILE:
        raise ValueError(f"it has more than {LARGEST_FILE / 1e6:.0f} MB")
    text = path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    try:
        return parse(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
