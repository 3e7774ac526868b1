"""Translation of a law's equation to NumPy code."""

from __future__ import annotations

import ast
from typing import Any, NamedTuple

from ...effects.base import ActuatorLaw, BodyLaw, RecordingLaw, TorqueLaw, TransmissionLaw
from ...types import Law

SIGNALS = ("t", "q", "v", "a", "load", "jacobian")
_NUMPY = (
    "abs sign exp log sqrt sin cos tan arctan arctan2 sinh cosh tanh clip where sum array cross minimum maximum interp"
).split()
_VARIABLES = ("q", "v", "a", "load")  # variable of an empirical torque, by its number
_REASONS = {
    RecordingLaw: "changes the recorded values, not the torque",
    ActuatorLaw: "limits the torque of the actuator, independent of the motion",
    TransmissionLaw: "has its own dynamics between motor and link",
}


class Code(NamedTuple):
    """A law as a NumPy function: name, arguments, parameters and returned expression."""

    name: str
    signals: tuple[str, ...]  # subset of SIGNALS
    numbers: dict[str, Any]
    expression: str


def code_of(law: Law) -> Code | None:
    """Translate a law; None if it is not a function of time, motion, load and Jacobian."""
    effect = law.effect
    if not isinstance(effect, TorqueLaw | BodyLaw) or effect.memory:
        return None
    name, renamed = effect.name, dict[str, str]()
    numbers: dict[str, Any] = {key: float(x) for key, x in effect.filled(law.parameters).items()}
    if name == "empirical":
        name, numbers, renamed = _empirical(numbers)
    try:
        tree = ast.parse(effect.equation, mode="eval")
    except SyntaxError:
        return None
    code = _Plain(set(numbers), renamed)
    expression = ast.unparse(code.visit(tree))
    joints = effect.scope in ("joint", "pair", "robot")
    return (
        Code(name, tuple(s for s in SIGNALS if s in code.used), numbers, expression) if joints and code.known else None
    )


def why_not(law: Law) -> str:
    """Reason why a law is not a function of time and motion."""
    kind = next((text for kind, text in _REASONS.items() if isinstance(law.effect, kind)), None)
    if kind:
        return kind
    return "has a memory" if law.effect.memory else "needs the rigid bodies"


def _empirical(numbers: dict[str, float]) -> tuple[str, dict[str, Any], dict[str, str]]:
    """Name, parameters with knots and values as lists, and renamed variable of an empirical torque."""
    signal = _VARIABLES[int(numbers["variable"])]
    lists = {key + "s": [x for k, x in numbers.items() if k.startswith(f"{key}_")] for key in ("knot", "value")}
    return f"empirical_{signal}", lists, {"variable": signal}


class _Plain(ast.NodeTransformer):
    """Replace functions by NumPy's; record the signals used and whether all names are known."""

    def __init__(self, numbers: set[str], renamed: dict[str, str]) -> None:
        self.numbers, self.renamed = numbers, renamed
        self.used: set[str] = set()
        self.known = True

    def visit_Name(self, node: ast.Name) -> ast.expr:
        name = self.renamed.get(node.id, node.id)
        if name in self.numbers:
            return ast.Name(name)
        if name in SIGNALS:
            self.used.add(name)
            return ast.Name(name)
        self.known &= name in _NUMPY or name == "norm"
        return ast.Attribute(ast.Name("np"), name if name != "norm" else "linalg.norm")
