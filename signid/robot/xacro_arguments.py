"""Arguments of a xacro file, as `xacro FILE NAME:=VALUE` has them: values by name, given as texts or in Python."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ..errors import CONTROL, OptionError, unexpected

ASSIGNED = re.compile(r"[A-Za-z_][\w.\-/]*:=")  # begins an argument and its value
LONGEST = 10_000  # value of an argument [characters]
MOST = 1000  # arguments


def parse_arguments(texts: Sequence[str]) -> dict[str, str]:
    """Values of xacro arguments by name, from texts NAME:=VALUE.

    Raises:
        OptionError: a text of another form, or two values for one name.
    """
    found: dict[str, str] = {}
    for text in texts:
        if not ASSIGNED.match(text):
            raise OptionError(f"--xacro {text[:80]!r} is not an argument and its value; write NAME:=VALUE")
        name, _, value = text.partition(":=")
        if name in found:
            raise OptionError(f"--xacro names the argument {name} twice; give one value for it")
        found[name] = value
    return as_arguments(found)


def as_arguments(given: Mapping[str, object] | None) -> dict[str, str]:
    """Values of xacro arguments as texts, as xacro takes them: True becomes true.

    Raises:
        OptionError: not a mapping of names to texts, numbers or truth values, or too many or too long ones.
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise unexpected("xacro", "values by name of the argument", given, '{"name": "ur5e"}')
    if len(given) > MOST:
        raise OptionError(f"xacro has {len(given)} arguments; give {MOST} at most")
    return {_name(name): _value(name, value) for name, value in given.items()}


def _name(name: object) -> str:
    if not isinstance(name, str) or not ASSIGNED.fullmatch(f"{name}:="):
        raise OptionError(f"xacro has {str(name)[:80]!r} as the name of an argument; give letters, digits and _")
    return name


def _value(name: str, value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str | int | float):
        kind = type(value).__name__
        raise OptionError(f"the xacro argument {name} is of type {kind}; give a text, a number, True or False")
    text = value if isinstance(value, str) else repr(value)
    if len(text) > LONGEST or CONTROL.search(text) or any("\ud800" <= letter <= "\udfff" for letter in text):
        raise OptionError(f"the value of the xacro argument {name} is no text of one line; give one of UTF-8")
    return text
