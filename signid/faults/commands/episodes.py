"""Episodes or files in which a joint answers its command in another way than in all others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...recording.formats.base import About
from ...types import Array, Recording
from .response import best_shift
from .rows import Grid, Part, on_grid

FEWEST = 3  # episodes that move, of which one may differ
MOVES, SECONDS = 0.05, 1.0  # share of the largest range of motion [1] and duration [s], from which an episode counts
FOLLOWS, LOST = 0.9, 0.5  # correlation of the other episodes, and of one that does not follow
OTHER, NEARER = 0.95, 0.25  # correlation with another joint's command, and 1 - it over that with the own one
SCALES, ALIKE = 1.5, 1.15  # ratio of the scale to that of the others, and largest one of the others among each other
ZERO, ZERO_LEAST = 0.1, 0.15  # [range] and [rad or m] by which the mean error differs from that of the others
LATE, PERIODS = 0.4, 3.0  # [s] and [periods] by which the shift differs; dry friction in slow motion: below 0.27 s
APART = 3.0  # difference of the error over the largest one among the others


class Episode(NamedTuple):
    """Parts of one joint that belong together: those of an episode, of a file, or one alone."""

    name: str  # "episode 7", a file, or "12.3 to 14.6 s"
    parts: tuple[Part, ...]


def group(recordings: Sequence[Recording], parts: Sequence[Part]) -> list[Episode]:
    """Parts of one joint by episode where recordings have some, else by recording, else one by one."""
    found: dict[str, list[Part]] = {}
    for part in parts:
        starts = About.of(recordings[part.recording].table).episodes
        file = recordings[part.recording].path or f"recording {part.recording + 1}"
        own = [name for first, name in starts if first <= part.t[0]][-1:] if len(starts) > 1 else []
        if not own and len(recordings) == 1:
            own = [f"{part.t[0]:.6g} to {part.t[-1]:.6g} s"]
        found.setdefault(" of ".join(own + [file] * (len(recordings) > 1)), []).append(part)
    return [Episode(name, tuple(each)) for name, each in found.items()]


class Odd(NamedTuple):
    """An episode of one joint that differs from the others."""

    joint: str
    episode: Episode
    said: str


class _Answer(NamedTuple):
    episode: Episode
    grids: list[Grid]
    range: float  # [unit] largest one of the command
    moves: bool
    correlation: float  # [1] at the usual shift, with its sign
    scale: float  # [1] motion per command
    zero: float  # [unit] mean of the command at the usual shift less q
    shift: float  # [s] of the episode alone
    best: float  # [1] correlation there


def odd_episodes(episodes: Mapping[str, Sequence[Episode]], period: float, units: Mapping[str, str]) -> tuple[Odd, ...]:
    """Episodes of joints that differ from the others; period of the grid [s], units of joints ("" if unknown)."""
    grids = {joint: [[on_grid(part, period) for part in each.parts] for each in own] for joint, own in episodes.items()}
    places = {joint: _places(own, grids[joint]) for joint, own in episodes.items()}
    found: list[Odd] = []
    for joint, own in episodes.items():
        answers = _answers(own, grids[joint])
        for k, one in enumerate(answers):
            others = [*answers[:k], *answers[k + 1 :]]
            commands = {name: _same(places[name], one) for name in episodes if name != joint}
            said = next(_differences(one, others, commands, period), "") or _moved(one, others, units.get(joint, "rad"))
            found += [Odd(joint, one.episode, f"{joint} {said}")] if said else []
    return tuple(found)


def _answers(episodes: Sequence[Episode], grids: Sequence[list[Grid]]) -> list[_Answer]:
    """Answers of the episodes that last."""
    lasting = [k for k, each in enumerate(grids) if sum(len(grid.q) * grid.period for grid in each) >= SECONDS]
    ranges = [max(float(np.ptp(grid.command)) for grid in grids[k]) for k in lasting]
    moves = [size > 0 and size >= MOVES * max(ranges) for size in ranges]
    shifts = [best_shift(grids[k]) for k in lasting]
    found = [x.seconds for x in shifts if np.isfinite(x.seconds) and x.correlation > FOLLOWS]
    usual = float(np.median(found)) if found else 0.0
    answers = []
    for k, shift, size, moving in zip(lasting, shifts, ranges, moves, strict=True):
        r, scale = _at(grids[k], [grid.command for grid in grids[k]], usual)
        error = np.concatenate([_late(grid.command, usual, grid.period) - grid.q for grid in grids[k]])
        zero = float(error.mean())
        answers.append(_Answer(episodes[k], grids[k], size, moving, r, scale, zero, shift.seconds, shift.correlation))
    return answers


def _late(command: Array, shift: float, period: float) -> Array:
    """A command (N,) that is late by a shift [s]."""
    rows = min(len(command), max(0, round(shift / period)))
    return np.concatenate([np.full(rows, command[0]), command[: len(command) - rows]])


def _at(grids: Sequence[Grid], commands: Sequence[Array], shift: float) -> tuple[float, float]:
    """Correlation of the position with commands at a shift [s], and motion per command; zeros without motion."""
    late = [_late(command, shift, grids[0].period) for command in commands]
    x = np.concatenate([command - command.mean() for command in late])
    y = np.concatenate([grid.q - grid.q.mean() for grid in grids])
    size = float(x @ x) * float(y @ y)
    return (float(x @ y) / size**0.5, float(x @ y) / float(x @ x)) if size > 0 else (0.0, 0.0)


_Place = tuple[int, float, int]  # recording, first time and rows of a part


def _places(episodes: Sequence[Episode], grids: Sequence[list[Grid]]) -> dict[_Place, Grid]:
    """Grids of one joint by the places of their parts."""
    each = [pair for own, some in zip(episodes, grids, strict=True) for pair in zip(own.parts, some, strict=True)]
    return {_place(part, grid): grid for part, grid in each}


def _place(part: Part, grid: Grid) -> _Place:
    return part.recording, float(part.t[0]), len(grid.q)


def _same(places: Mapping[_Place, Grid], one: _Answer) -> list[Array] | None:
    """Commands of another joint in the rows of an episode; None if it lacks some of them."""
    found = [places.get(_place(part, grid)) for part, grid in zip(one.episode.parts, one.grids, strict=True)]
    return [grid.command for grid in found if grid is not None] if all(grid is not None for grid in found) else None


def _differences(
    one: _Answer, everyone: Sequence[_Answer], commands: Mapping[str, list[Array] | None], period: float
) -> Iterator[str]:
    """Sentences on the motion of one episode that differs from that of the others, the likeliest first."""
    others = [each for each in everyone if each.moves]
    if not one.moves or len(others) < FEWEST - 1 or np.median([each.correlation for each in others]) < FOLLOWS:
        return
    where = f"in {one.episode.name}, unlike in the others"
    shift = _middle([each.shift for each in others])
    near = {name: _at(one.grids, own, shift)[0] for name, own in commands.items() if own is not None}
    name = max(near, key=lambda each: near[each], default="")
    against = f"moves against its command {where}: q or q_des has the wrong sign there; negate it, or leave it out"
    if one.correlation < -FOLLOWS:
        yield against
    if name and near[name] > OTHER and 1 - near[name] < NEARER * (1 - one.correlation):
        yield f"follows q_des of {name} {where}: joints are swapped there; swap their columns back, or leave it out"
    if one.correlation < -LOST:
        yield against
    late, nearer = one.shift - shift, 1 - one.best < NEARER * (1 - one.correlation)
    if abs(late) > max(LATE, PERIODS * period) and nearer and one.best > OTHER and _agree(others):
        way = "later" if late > 0 else "earlier"
        yield f"answers {1e3 * abs(late):.0f} ms {way} {where}: q and q_des are of different rows there; leave it out"
    if max(one.correlation, one.best) < LOST:
        yield f"does not follow its command {where}: the drive is off or rows are damaged there; leave it out"
    scales = [each.scale for each in others]
    ratio = one.scale / _middle(scales) if _middle(scales) > 0 else 1.0
    alike = min(scales) > 0 and max(scales) < ALIKE * min(scales)
    if one.correlation > FOLLOWS and alike and not 1 / SCALES <= ratio <= SCALES:
        yield f"moves by {ratio:.3g} of what it does in the others in {one.episode.name}: check units and scale there"


def _moved(one: _Answer, others: Sequence[_Answer], unit: str) -> str:
    """Describe another zero of an episode than that of the others, which agree; "" if it is the same."""
    if len(others) < FEWEST - 1 or (one.moves and one.correlation < FOLLOWS):
        return ""
    usual, apart = _middle([each.zero for each in others]), _spread([each.zero for each in others])
    span = max(each.range for each in (one, *others))
    if not abs(one.zero - usual) > max(ZERO_LEAST if unit else 0.0, ZERO * span, APART * apart):
        return ""
    size, way = f"{abs(one.zero - usual):.3g} {unit}".rstrip(), "below" if one.zero > usual else "above"
    where = f"in {one.episode.name}, unlike in the others"
    return f"is {size} {way} its usual place {where}: the zero has changed; calibrate it, or leave it out"


def _agree(others: Sequence[_Answer]) -> bool:
    """Whether all follow at the usual shift."""
    return min(each.correlation for each in others) > FOLLOWS


def _middle(values: Sequence[float]) -> float:
    known = _finite(values)
    return float(np.median(known)) if len(known) else 0.0


def _spread(values: Sequence[float]) -> float:
    """Largest difference from the median."""
    return float(np.abs(_finite(values) - _middle(values)).max(initial=0.0))


def _finite(values: Sequence[float]) -> Array:
    return np.asarray(values, float)[np.isfinite(values)]
