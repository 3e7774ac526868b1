"""A limit of time on searches. Where it cuts one short the result says so: it may differ on another machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, ParamSpec, Protocol, TypeVar, cast

from .errors import OptionError

USUAL = 3600.0  # [s], of a verb where no other limit is set


@dataclass(frozen=True)
class _Limit:
    seconds: float
    end: float  # of time.monotonic() [s]
    ended: dict[str, None] = field(default_factory=dict)  # what was cut short


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
    """Until the limit; infinite where there is none [s]."""
    return max(min((limit.end for limit in _LIMITS.get()), default=float("inf")) - time.monotonic(), 0.0)


def time_is_up(search: str) -> bool:
    """Whether a search must end here; a sentence will begin with its name."""
    up = seconds_left() <= 0
    for limit in _LIMITS.get() if up else ():
        limit.ended[search] = None
    return up


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
        with _limited(USUAL if not _LIMITS.get() else float("inf")) as limit:
            found = verb(*args, **kwargs)
        if not limit.ended:
            return found
        told = (
            f"{search} was cut short after {seconds:g} s: this is the best found until then, another run may differ; "
            "give it longer (--time-limit)"
            for search in limit.ended
        )
        flags, result = dict.fromkeys((*found.flags, *told)), cast("Any", found)
        return cast("_R", replace(result, flags=tuple(flags)))

    return within


@contextmanager
def _limited(seconds: float) -> Iterator[_Limit]:
    limit = _Limit(seconds, time.monotonic() + seconds)
    token = _LIMITS.set((*_LIMITS.get(), limit))
    try:
        yield limit
    finally:
        _LIMITS.reset(token)
