"""Steps of a diagnosis that several settings of its constants share."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from signid.errors import InputError

from .constants import BESIDE_MISFIT, CONSTANTS, SEARCH, Setting

RUN = import_module("signid.diagnose.run")
Memory = dict[Hashable, Any]


@contextmanager
def shared_steps(memory: Memory, values: Setting) -> Iterator[None]:
    """Reuse prepared recordings, rows and searches of earlier diagnoses of the same case; leave out the roll-outs.

    The same model and recordings are diagnosed each time. An identified model is asked two questions, with and without
    its misfit, so rows and searches are kept for each. A search is reused only where no constant that it reads differs.

    Args:
        memory: results of the case so far.
        values: constants that are not as they are.
    """

    def select_key(data: Any, *_: Any) -> Hashable:
        known = data.model.misfit is not None
        read = {SEARCH, BESIDE_MISFIT} if known else {SEARCH}
        return "select", known, tuple(x for x in values if CONSTANTS[x[0]].step in read)

    before = {name: getattr(RUN, name) for name in ("prepare_session", "build_in_time", "select", "roll_out")}
    kept = {
        "prepare_session": _kept(memory, before["prepare_session"], lambda model, *_: "prepare"),
        "build_in_time": _kept(memory, before["build_in_time"], lambda model, *_: ("build", model.misfit is None)),
        "select": _kept(memory, before["select"], select_key),
        "roll_out": _no_roll_out,
    }
    try:
        for name, function in kept.items():
            setattr(RUN, name, function)
        yield
    finally:
        for name, function in before.items():
            setattr(RUN, name, function)


def _kept(memory: Memory, function: Callable[..., Any], key: Callable[..., Hashable]) -> Callable[..., Any]:
    """Function that is called once per key."""

    def call(*given: Any) -> Any:
        name = key(*given)
        if name not in memory:
            memory[name] = function(*given)
        return memory[name]

    return call


def _no_roll_out(*_: Any, **__: Any) -> Any:
    raise InputError("roll-outs change no name")
