"""Time limits, early stops and progress of searches; verbs run on one thread.

The result of a truncated search is flagged, because another run may differ.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, ParamSpec, Protocol, TypeVar, cast

from threadpoolctl import ThreadpoolController

from .errors import OptionError

DEFAULT_TIME_LIMIT = 3600.0  # [s] default time limit of a verb


@dataclass
class _Limit:
    seconds: float
    end: float  # [s] on the clock of time.monotonic()
    ended: dict[str, None] = field(default_factory=dict)  # names of truncated searches
    searching: bool = False  # whether a search is running that already has an answer
    stopped: str = ""  # reason of an early stop, "" without one


_Listener = Callable[[str, float], None]  # current step, completed share [1]
_LISTENER: ContextVar[_Listener | None] = ContextVar("listener", default=None)
_OPEN_LIMITS: ContextVar[tuple[_Limit, ...]] = ContextVar("limits", default=())  # innermost last


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Limit the duration of searches; a truncated search returns its best result and sets a flag.

    >>> with signid.time_limit(60):
    ...     found = signid.identify("3r", "robots/3r/recording.parquet")

    Reading, filtering and least squares are not interrupted, but their duration counts.

    Args:
        seconds: time limit of the whole block [s].

    Raises:
        OptionError: the limit is not positive.
    """
    if not seconds > 0:
        raise OptionError(f"the time limit is {seconds:g} s; give a positive number of seconds")
    with _open_limit(seconds):
        yield


def seconds_left() -> float:
    """Time until the limit [s]; infinite without a limit, zero after a stop."""
    if any(limit.stopped for limit in _OPEN_LIMITS.get()):
        return 0.0
    return max(min((limit.end for limit in _OPEN_LIMITS.get()), default=float("inf")) - time.monotonic(), 0.0)


def time_is_up(search: str, answer: bool = True) -> bool:
    """True once the time limit has passed; the name of the search becomes the subject of the flag.

    `answer`: whether the search already has an answer; False while it prepares its first one.
    """
    up = seconds_left() <= 0
    for limit in _OPEN_LIMITS.get():
        limit.searching |= answer
        if up:
            limit.ended[search] = None
    return up


def stop_searches(reason: str) -> bool:
    """End all running searches as at the time limit; their results get the flag "stopped early by REASON: ...".

    Nothing is stopped, and False returned, if no search has an answer yet.
    """
    limits = _OPEN_LIMITS.get()
    if not any(limit.searching for limit in limits):
        return False
    for limit in limits:
        limit.stopped = limit.stopped or reason
    return True


@contextmanager
def steps_shown(progress: _Listener | None, start: float = 0.0, stop: float = 1.0) -> Iterator[None]:
    """Report the steps of searches (`show_step`) to a progress function; the block is the share `start` to `stop`."""
    most = start

    def listen(step: str, share: float) -> None:
        nonlocal most
        most = max(most, start + (stop - start) * min(max(share, 0.0), 1.0))
        if progress is not None:
            progress(step, most)

    token = _LISTENER.set(listen)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def show_step(step: str, share: float) -> None:
    """Report the current step of a search and its completed share [1]; without effect outside of `steps_shown`.

    A decrease of the share is ignored.
    """
    if listener := _LISTENER.get():
        listener(step, share)


class OutOfTimeError(Exception):
    """Work without a useful partial result was aborted at the time limit."""


def need_time(search: str) -> None:
    """Abort work without a useful partial result once the time limit has passed.

    Raises:
        OutOfTimeError: the time limit has passed.
    """
    if time_is_up(search, answer=False):
        raise OutOfTimeError(search)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS to one thread within the block: for small matrices, more threads are up to seven times slower."""
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        yield


class _Flagged(Protocol):
    @property
    def flags(self) -> tuple[str, ...]: ...


_P = ParamSpec("_P")
_R = TypeVar("_R", bound=_Flagged)


def ends_in_time(verb: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a verb with the default time limit of one hour; flag results of truncated searches."""

    @wraps(verb)
    def within(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        seconds = min((limit.seconds for limit in _OPEN_LIMITS.get()), default=DEFAULT_TIME_LIMIT)
        with one_thread(), _open_limit(DEFAULT_TIME_LIMIT if not _OPEN_LIMITS.get() else float("inf")) as limit:
            result = verb(*args, **kwargs)
        if not (limit.ended or limit.stopped):
            return result
        flags = tuple(dict.fromkeys((*result.flags, *_truncation_flags(limit, seconds))))
        return cast("_R", replace(cast("Any", result), flags=flags))

    return within


def _truncation_flags(limit: _Limit, seconds: float) -> list[str]:
    if not limit.stopped:
        return [
            f"{search} was cut short after {seconds:g} s and returns its best result so far; another run may differ; "
            "allow more time (--time-limit)"
            for search in limit.ended
        ]
    *others, last = limit.ended or ("",)
    if not last:
        return [f"stopped early by {limit.stopped}: all searches had already ended, the result is complete"]
    searches = f"{', '.join(others)} and {last}" if others else last
    return [
        f"stopped early by {limit.stopped}: {searches} ended with the best result so far; run the command again "
        "without a stop for the complete result"
    ]


@contextmanager
def _open_limit(seconds: float) -> Iterator[_Limit]:
    limit = _Limit(seconds, time.monotonic() + seconds)
    token = _OPEN_LIMITS.set((*_OPEN_LIMITS.get(), limit))
    try:
        yield limit
    finally:
        _OPEN_LIMITS.reset(token)
