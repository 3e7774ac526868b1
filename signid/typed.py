"""Types of the arguments of public verbs: one sentence where an argument is of another type than its annotation."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from itertools import islice
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from .errors import OptionError, SignidError

MAX_ELEMENTS = 100  # elements of a sequence that are compared with its annotation

Arguments = ParamSpec("Arguments")
Value = TypeVar("Value")


def typed(verb: Callable[Arguments, Value]) -> Callable[Arguments, Value]:
    """Public verb that names an argument of a wrong type, if it fails because of one.

    Arguments are looked at after a failure only, so that every call that works stays as it is.

    Raises:
        OptionError: an argument is of another type than its annotation says.
    """

    @wraps(verb)
    def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
        try:
            return verb(*args, **kwargs)
        except SignidError:
            raise
        except Exception as error:
            if sentence := _wrong_type(verb, args, kwargs):
                raise OptionError(sentence) from error
            raise

    return call


def _wrong_type(verb: Callable[..., Any], args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> str:
    """Sentence on the first argument that does not fit its annotation; empty without one."""
    signature = inspect.signature(verb)
    try:
        bound = signature.bind(*args, **kwargs).arguments
    except TypeError as error:
        return f"{verb.__name__}: {error}; it takes {', '.join(signature.parameters)}"
    hints = _hints(verb)
    for name, value in bound.items():
        if not fits(value, hints.get(name, Any)):
            given = "None" if value is None else type(value).__name__
            expected = signature.parameters[name].annotation
            return f"{verb.__name__}: {name} is {given}, or holds another type; expected {expected}"
    return ""


def _hints(verb: Callable[..., Any]) -> Mapping[str, Any]:
    """Type of each annotation; a name that only type checkers import stands for anything."""
    unknown = dict[str, Any]()
    while True:
        try:
            return get_type_hints(verb, localns=unknown)
        except NameError as error:
            if not error.name or error.name in unknown:
                return {}
            unknown[error.name] = Any
        except (AttributeError, TypeError):  # an annotation that exists for type checkers alone
            return {}


def fits(value: Any, hint: Any) -> bool:
    """Whether a value is of an annotated type; numbers of any precision fit, and what is not understood does."""
    origin, parts = get_origin(hint) or hint, get_args(hint)
    if origin in (Union, UnionType):
        return any(fits(value, part) for part in parts)
    if origin is Literal:
        return any(value is part or (type(value) is type(part) and value == part) for part in parts)
    if hint in (None, NoneType):
        return value is None
    if origin in (float, int):
        return isinstance(value, Real if origin is float else Integral) and not isinstance(value, bool | np.bool_)
    if origin is np.ndarray:
        return _is_numeric(value)
    if not isinstance(origin, type):
        return True
    try:
        right = isinstance(value, origin)
    except TypeError:  # a protocol that cannot be checked
        return True
    return right and not (isinstance(value, str | bytes) and origin is not type(value)) and _holds(value, origin, parts)


def _holds(value: Any, origin: type, parts: tuple[Any, ...]) -> bool:
    """Whether the elements of a container are of their annotated types."""
    if issubclass(origin, Mapping) and len(parts) == 2:
        return all(fits(key, parts[0]) and fits(one, parts[1]) for key, one in islice(value.items(), MAX_ELEMENTS))
    if origin is tuple and parts and parts[-1] is not Ellipsis:
        return len(value) == len(parts) and all(map(fits, value, parts))
    if issubclass(origin, Iterable) and parts and not callable(value) and hasattr(value, "__len__"):
        return all(fits(one, parts[0]) for one in islice(value, MAX_ELEMENTS))
    return True


def _is_numeric(value: Any) -> bool:
    try:
        return bool(np.asarray(value).dtype.kind in "fiub")
    except ValueError:  # rows of different lengths
        return False
