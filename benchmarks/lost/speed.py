"""How much faster signs are found than by the classical tree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rich.table import Table

from . import paper
from .row import Verdict
from .show import frame
from .trial import attempt

LEAST = 400.0  # times, end to end


@dataclass(frozen=True)
class Race:
    """Two ways to the same signs, in seconds more than the sign-known identification takes."""

    name: str
    rival: str
    exact: float  # s
    other: float  # s
    least: float  # times

    @property
    def verdict(self) -> Verdict:
        """Whether the exact way is as many times faster as it should be."""
        times = self.other / self.exact
        return Verdict(f"{self.name}, {self.rival}: {times:.0f} times faster ({self.least:g})", times >= self.least)


def rows() -> Iterator[Race]:
    """Both arms of the paper by tree, one of seven joints by beam."""
    for puzzle in paper.puzzles(anew=False):
        if puzzle.group == "3R":
            exact, tree = (attempt(puzzle, method).seconds for method in ("exact", "tree"))
            yield Race(f"3R {puzzle.case}", "tree by nlopt", exact, tree, LEAST)


def show(races: list[Race]) -> Table:
    """One race a line."""
    table = frame("time", ("", "against", "exact, s", "other, s", "times"), left=2)
    for race in races:
        figures = (f"{race.exact:.3f}", f"{race.other:.2f}", f"{race.other / race.exact:.0f}")
        table.add_row(race.name, race.rival, *figures)
    return table
