"""Shell completion: names of robots, laws and data sets; where no name fits, the shell completes file names."""

from __future__ import annotations

from collections.abc import Iterable


def complete_robot(incomplete: str) -> list[str]:
    """Names of robots that begin with a text."""
    from ..robot.locate import names

    return _beginning(incomplete, names())


def complete_law(incomplete: str) -> list[str]:
    """Names of laws that begin with a text; in a list, those of its last name."""
    from ..effects import DRIVE_EFFECTS, EFFECTS

    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in _beginning(last, [*EFFECTS.names, *DRIVE_EFFECTS.names])]


def complete_data(incomplete: str) -> list[str]:
    """Names of public data sets that begin with a text."""
    from ..recording.gallery import DATA

    return _beginning(incomplete, (one.name for one in DATA))


def complete_number(incomplete: str) -> list[str]:
    """Names of numbers of a drive that begin with a text, up to their value."""
    from ..servos import SERVO_NUMBERS

    return _beginning(incomplete, (f"{name}=" for name in SERVO_NUMBERS))


def complete_known(incomplete: str) -> list[str]:
    """Sources of the scale of torque, and names of numbers of a drive."""
    return [*_beginning(incomplete, ("masses", "nothing")), *complete_number(incomplete)]


def _beginning(text: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(text)]
