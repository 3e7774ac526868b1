"""Tuned constants of diagnosis, their other values, and how to set them for a while."""

from __future__ import annotations

import pkgutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType

ROOT = "signid.diagnose"
SEARCH, BESIDE_MISFIT, CONCLUSION = "search", "search beside a known misfit", "conclusion"  # first reader of a constant
Setting = tuple[tuple[str, float], ...]  # names and values of the constants that are not as they are, sorted


@dataclass(frozen=True)
class Constant:
    """A tuned constant and the values that it is compared with."""

    name: str
    module: str  # its home, below signid.diagnose
    step: str  # SEARCH, BESIDE_MISFIT or CONCLUSION
    others: tuple[float, ...]

    @property
    def present(self) -> float:
        """Its present value."""
        return float(getattr(import_module(f"{ROOT}.{self.module}"), self.name))

    @property
    def values(self) -> tuple[float, ...]:
        """The present value, then the others."""
        return (self.present, *self.others)


TABLE = (
    Constant("MISFIT_GROWTH", "evidence.thresholds", BESIDE_MISFIT, (1.5, 3.0)),
    Constant("FIRST_LOG_ODDS", "search.thresholds", SEARCH, (3.0, 6.0)),
    Constant("NEXT_LOG_ODDS", "search.thresholds", SEARCH, (2.0, 5.0)),
    Constant("NOISE_ERROR", "search.thresholds", SEARCH, (1.0, 1.8)),
    Constant("CAUSE_SHARE", "findings.thresholds", CONCLUSION, (0.07, 0.3)),
    Constant("REPLACEMENT_RATIO", "findings.thresholds", CONCLUSION, (1.1, 2.5)),
    Constant("WORSE_WEIGHT", "findings.thresholds", CONCLUSION, (1.0, 6.0)),
    Constant("LEAST_GAIN", "findings.thresholds", CONCLUSION, (0.5, 2.0)),
    Constant("SAME_PREDICTION", "findings.thresholds", CONCLUSION, (0.05, 0.2)),
    Constant("SAID", "findings.thresholds", CONCLUSION, (0.3, 0.7)),
)
CONSTANTS = {one.name: one for one in TABLE}


def setting(values: Mapping[str, float]) -> Setting:
    """Setting of some constants, without those that keep their present value.

    Args:
        values: value by name.
    """
    return tuple(sorted((name, float(x)) for name, x in values.items() if float(x) != CONSTANTS[name].present))


@contextmanager
def applied(values: Setting) -> Iterator[None]:
    """Set constants in each module of signid.diagnose that holds them, and restore them in the end.

    Args:
        values: names and values.
    """
    _import_all()
    changed = [(module, name, module.__dict__[name]) for name, _ in values for module in _holders(name)]
    wanted = dict(values)
    try:
        for module, name, _ in changed:
            setattr(module, name, wanted[name])
        yield
    finally:
        for module, name, before in changed:
            setattr(module, name, before)


def _holders(name: str) -> list[ModuleType]:
    """Modules that hold the very object of a constant."""
    own = getattr(sys.modules[f"{ROOT}.{CONSTANTS[name].module}"], name)
    below = [x for key, x in list(sys.modules.items()) if key.startswith(f"{ROOT}.")]
    return [x for x in below if x.__dict__.get(name) is own]


def _import_all() -> None:
    """Import every module of signid.diagnose: a later import would copy a value that is set for a while."""
    for found in pkgutil.walk_packages(import_module(ROOT).__path__, f"{ROOT}."):
        import_module(found.name)
