"""Time limits of searches, early stops, and what a search is trying.

A result whose search was cut short is flagged, since another run may differ.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, ParamSpec, Protocol, TypeVar, cast

from .errors import OptionError
from .threads import one_thread

USUAL = 3600.0  # [s], of a verb where no other limit is set


@dataclass
class _Limit:
    seconds: float
    end: float  # of time.monotonic() [s]
    ended: dict[str, None] = field(default_factory=dict)  # searches that were cut short
    searching: bool = False  # a search looked at the clock: it has an answer, if not its best
    stopped: str = ""  # what ended the searches before their time


_Listener = Callable[[str, float], None]  # what is being tried, and the share that is done [1]
_LISTENER: ContextVar[_Listener | None] = ContextVar("listener", default=None)
_LIMITS: ContextVar[tuple[_Limit, ...]] = ContextVar("limits", default=())  # the innermost last


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Searches inside end after so many seconds, with the best found until then; `flags` of the result say so.

    Reading, filtering and least squares are no searches: they take the time that they take.

    Args:
        seconds: of all searches inside together with what else is done there [s].

    Raises:
        OptionError: the limit is no positive number.
    """
    if not seconds > 0:
        raise OptionError(f"the time limit is {seconds:g} s; give a positive number of seconds")
    with _limited(seconds):
        yield


def seconds_left() -> float:
    """Until the limit; infinite where there is none, zero after a stop [s]."""
    if any(limit.stopped for limit in _LIMITS.get()):
        return 0.0
    return max(min((limit.end for limit in _LIMITS.get()), default=float("inf")) - time.monotonic(), 0.0)


def time_is_up(search: str, answer: bool = True) -> bool:
    """Whether a search must end here.

    Args:
        search: its name, the subject of the flag's sentence.
        answer: whether the search could end here with an answer; False while it prepares its first one.
    """
    up = seconds_left() <= 0
    for limit in _LIMITS.get():
        limit.searching |= answer
        if up:
            limit.ended[search] = None
    return up


def stop_searches(reason: str) -> bool:
    """End all searches under way as if their time were up, and flag their results.

    Args:
        reason: what asked for it, for the sentence "stopped early by REASON: ...".

    Returns:
        False where no search has an answer yet; nothing is stopped then.
    """
    limits = _LIMITS.get()
    if not any(limit.searching for limit in limits):
        return False
    for limit in limits:
        limit.stopped = limit.stopped or reason
    return True


@contextmanager
def steps_shown(progress: _Listener | None, start: float = 0.0, stop: float = 1.0) -> Iterator[None]:
    """What searches inside say with `show_step` goes to a progress function.

    Args:
        progress: called with what is being done and the share of the whole that is done [1]; None hears nothing.
        start: share that is done when the searches begin [1].
        stop: and when they have ended [1].
    """
    most = start

    def listen(what: str, share: float) -> None:
        nonlocal most
        most = max(most, start + (stop - start) * min(max(share, 0.0), 1.0))
        if progress is not None:
            progress(what, most)

    token = _LISTENER.set(listen)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def show_step(what: str, share: float) -> None:
    """Say what a search is trying now; nobody hears it outside of `steps_shown`.

    Args:
        what: "weighing laws".
        share: of the search that is done; a share below the last one is ignored [1].
    """
    listener = _LISTENER.get()
    if listener is not None:
        listener(what, share)


class OutOfTimeError(Exception):
    """Work that is of no use unless it is whole was given up."""


def need_time(search: str) -> None:
    """Go on with work of a search that has no answer without it.

    Args:
        search: its name, the subject of the flag's sentence.

    Raises:
        OutOfTimeError: time is up.
    """
    if time_is_up(search, answer=False):
        raise OutOfTimeError(search)


class _Flagged(Protocol):
    @property
    def flags(self) -> tuple[str, ...]: ...


_P = ParamSpec("_P")
_R = TypeVar("_R", bound=_Flagged)


def ends_in_time(verb: Callable[_P, _R]) -> Callable[_P, _R]:
    """A verb within an hour, unless another limit is set, whose result is flagged where time cut a search short."""

    @wraps(verb)
    def within(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        seconds = min((limit.seconds for limit in _LIMITS.get()), default=USUAL)
        with one_thread(), _limited(USUAL if not _LIMITS.get() else float("inf")) as limit:
            found = verb(*args, **kwargs)
        if not (limit.ended or limit.stopped):
            return found
        sentences = _stop_flags(limit) if limit.stopped else _limit_flags(limit, seconds)
        flags, result = dict.fromkeys((*found.flags, *sentences)), cast("Any", found)
        return cast("_R", replace(result, flags=tuple(flags)))

    return within


def _limit_flags(limit: _Limit, seconds: float) -> Iterator[str]:
    for search in limit.ended:
        yield (
            f"{search} was cut short after {seconds:g} s: this is the best found until then, another run may differ; "
            "give it longer (--time-limit)"
        )


def _stop_flags(limit: _Limit) -> Iterator[str]:
    *others, last = limit.ended or ("",)
    if not last:
        yield f"stopped early by {limit.stopped}: every search had ended before, the result is whole"
        return
    searches = f"{', '.join(others)} and {last}" if others else last
    yield (
        f"stopped early by {limit.stopped}: {searches} ended with the best found until then; run the command again "
        "without a stop for the whole result"
    )


@contextmanager
def _limited(seconds: float) -> Iterator[_Limit]:
    limit = _Limit(seconds, time.monotonic() + seconds)
    token = _LIMITS.set((*_LIMITS.get(), limit))
    try:
        yield limit
    finally:
        _LIMITS.reset(token)
