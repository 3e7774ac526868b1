"""One tree of errors. Each says in one sentence what was given, what was expected and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence


class SignidError(Exception):
    """Root of everything that signid raises on purpose."""


class InputError(SignidError, ValueError):
    """Something given cannot be used; the command line prints the sentence and exits with 2."""


class RobotError(InputError):
    """A robot description, a joint name or an actuators file cannot be used."""


class RecordingError(InputError):
    """A recording, one of its columns or its samples cannot be used."""


class OptionError(InputError):
    """An option or a plug-in name does not exist, or two options contradict each other."""


class DownloadError(SignidError, OSError):
    """A file cannot be had from its public source, or is not what it should be; nothing was written."""


class OutputError(SignidError, OSError):
    """A result cannot be written where it was asked for; nothing was left half-written."""


def shorten(names: Sequence[str], most: int = 8) -> str:
    """The names in a row, or the first of them and how many more there are."""
    more = len(names) - most
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:most])} and {more} more"
