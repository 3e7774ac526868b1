"""Exceptions. Each message is one sentence: the fact, the expectation and the remedy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextvars import ContextVar
from decimal import Decimal

# control characters, and separators of lines and paragraphs: they end comments of code and steer terminals
CONTROL = re.compile("[\\x00-\\x1f\\x7f-\\x9f\\u2028\\u2029]")
ON_COMMAND_LINE: ContextVar[bool] = ContextVar("sentences name options, not arguments of Python", default=False)
OPTION = re.compile(
    r"signid [a-z]+ [^;,:()]*|--(?:(method|signs|estimator) (\w+)|(actuators|bounds|columns|cutoff|effects|equal|"
    r"gravity|held-out|known|lock|package-dir|prior|rate|reference|refit|robust|skip|unsigned|xacro)\b"
    r"(?: ('.*?'|[\w.@*]+:?=[\w.:+-]*\w|[A-Z][A-Z,]*\b|-?\d[\d.,-]*\b))?)"
)


class SignidError(Exception):
    """Base class of all exceptions of signid; its sentence names Python's arguments, on the command line options."""

    def __str__(self) -> str:
        return named_for_caller(super().__str__())


class InputError(SignidError, ValueError):
    """Invalid input; the command line prints the message and exits with 2."""


class RobotError(InputError):
    """Invalid robot description, joint name or actuators file."""


class RecordingError(InputError):
    """Invalid recording, column or sample."""


class UndecidedReading(RecordingError):
    """A log whose drafted reading, `text`, has lines to choose; the command line writes it and exits with 3."""

    def __init__(self, sentence: str, text: str) -> None:
        super().__init__(sentence)
        self.text = text


class OptionError(InputError):
    """Unknown option or plug-in name, or contradictory options."""


class ManifestError(InputError):
    """Invalid list of sessions, with one message per invalid row."""

    def __init__(self, sentences: Sequence[str]) -> None:
        super().__init__("; ".join(sentences))
        self.sentences = tuple(sentences)


class DownloadError(SignidError, OSError):
    """Failed download, or a downloaded file with wrong content; nothing was written."""


class OutputError(SignidError, OSError):
    """Failed write of a result; no partial file remains."""


def readable(name: str) -> str:
    """Name of a file, or a text that holds such names; other bytes than UTF-8 become U+FFFD."""
    try:
        return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    except UnicodeEncodeError:  # no bytes of a file name
        return name.encode("utf-8", "replace").decode()


def one_line(text: str) -> str:
    """Text of one line without control characters, for comments, names in code, and terminals."""
    return " ".join(CONTROL.sub(" ", text).split())


def named_for_caller(sentence: str) -> str:
    """A sentence with Python's arguments in place of options, unless the command line runs."""
    return sentence if ON_COMMAND_LINE.get() else OPTION.sub(argument, sentence)


def argument(option: re.Match[str]) -> str:
    """Argument of Python in place of an option and its value; a whole command stays."""
    name, value = option[1] or option[3], option[2] or option[4] or ""
    if name is None:
        return option[0]
    if name in ("lock", "xacro") and "=" in value:
        key, _, value = value.replace(":=", "=").partition("=")
        value = f'{{"{key}": {value}}}'
    elif value and not value.isupper() and value[0] != "'":
        value = f"({value})" if name == "gravity" else value if name in ("cutoff", "rate") else f'"{value}"'
    given = {"held-out": "held_out", "package-dir": "package_dirs"}.get(name, name)
    if name in ("cutoff", "effects", "robust"):
        return f"options=signid.Options({name}={value or '...'})"
    return f"{given}={value or 'True' * (name in ('refit', 'unsigned'))}"


def unexpected(verb: str, wanted: str, given: object, advice: str) -> OptionError:
    """Error about an argument of another type: what the verb needs, what was given, and how to make it."""
    kind = "None" if given is None else type(given).__name__
    return OptionError(f"{verb} needs {wanted}, not {kind}; give {advice}")


def decimals(value: float, digits: int = 3) -> str:
    """Number with significant digits, without an exponent.

    >>> decimals(1172.3), decimals(0.000042, 1), decimals(2.0)
    ('1170', '0.00004', '2')
    """
    return format(Decimal(f"{value:.{digits}g}"), "f")


def shorten(names: Sequence[str], most: int = 8) -> str:
    """Names separated by commas; beyond `most`, the number of the others."""
    more = len(names) - most
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:most])} and {more} more"
