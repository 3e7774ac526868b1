"""Laws of a model as expressions, from the equations of their effects."""

from __future__ import annotations

import ast
import operator
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ....effects.base import BodyLaw, TorqueLaw
from ....model import Model, torque_model
from ....types import Law
from .graph import BINARY, UNARY, Graph, Scalar, binary, unary, where
from .rigid import Expressions

OPERATORS: dict[type[ast.AST], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Gt: operator.gt,
    ast.Lt: operator.lt,
}
_VARIABLES = ("q", "v", "a", "load")  # variable of an empirical torque, by its number


def writable(law: Law) -> bool:
    """Whether the torque of a law is a function of position, velocity, acceleration and rigid-body torque."""
    effect = law.effect
    if not isinstance(effect, TorqueLaw) or effect.memory or effect.scope not in ("joint", "pair", "robot", "any"):
        return False
    try:
        tree = ast.parse(effect.equation, mode="eval")
    except SyntaxError:
        return False
    known = {"q", "v", "a", "load", "variable", "knots", "values", "sum", "where", "interp", *UNARY, *BINARY}
    used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return used <= known | set(effect.filled(law.parameters))


def inertial(law: Law) -> bool:
    """Whether the inertial parameters of the bodies hold a law."""
    return isinstance(law.effect, BodyLaw)


def law_expressions(graph: Graph, model: Model, motion: Mapping[str, Expressions]) -> Expressions:
    """Torque (n,) of the laws that can be written.

    motion: "q", "v", "a" and "load" (n,) [rad or m, and their derivatives; N.m or N].
    """
    total = np.array([graph.constant(0.0)] * len(model.robot.joints))
    for law in filter(writable, torque_model(model).laws):
        joints = list(law.joints)
        single = len(joints) == 1
        signals = {key: x[joints[0]] if single else x[joints] for key, x in motion.items()}
        torque = _evaluate(graph, law, signals)
        for row, joint in enumerate(joints):
            total[joint] = total[joint] + (torque if single else torque[row])
    return total


def _evaluate(graph: Graph, law: Law, signals: Mapping[str, Any]) -> Any:
    numbers: dict[str, Any] = {key: float(x) for key, x in law.effect.filled(law.parameters).items()}
    if law.effect.name == "empirical":
        lists = {key + "s": [x for k, x in numbers.items() if k.startswith(f"{key}_")] for key in ("knot", "value")}
        numbers = {"variable": signals[_VARIABLES[int(numbers["variable"])]], **lists}
    functions: dict[str, Any] = {name: np.frompyfunc(partial(_unary, graph, name), 1, 1) for name in UNARY}
    functions |= {name: np.frompyfunc(partial(_binary, graph, name), 2, 1) for name in BINARY}
    functions |= {
        "where": np.frompyfunc(partial(_where, graph), 3, 1),
        "interp": partial(_interpolate, graph),
        "sum": sum,
    }
    return _value(ast.parse(law.effect.equation, mode="eval").body, {**functions, **signals, **numbers})


def _value(node: ast.expr, names: Mapping[str, Any]) -> Any:
    """Value of an equation: numbers, names, calls, arithmetic, comparisons by > and <, and reversal by [::-1]."""
    match node:
        case ast.Constant():
            return node.value
        case ast.Name():
            return names[node.id]
        case ast.UnaryOp(op=ast.USub()):
            return -_value(node.operand, names)
        case ast.BinOp():
            return OPERATORS[type(node.op)](_value(node.left, names), _value(node.right, names))
        case ast.Compare(ops=[ast.Gt() | ast.Lt()]):
            return OPERATORS[type(node.ops[0])](_value(node.left, names), _value(node.comparators[0], names))
        case ast.Call():
            return _value(node.func, names)(*(_value(x, names) for x in node.args))
        case ast.Subscript():
            return _value(node.value, names)[::-1]
    raise ValueError(f"an equation with {ast.dump(node)} cannot be written as code")


def _unary(graph: Graph, name: str, x: Any) -> Scalar:
    return unary(name, graph.scalar(x))


def _binary(graph: Graph, name: str, a: Any, b: Any) -> Scalar:
    return binary(name, graph.scalar(a), graph.scalar(b))


def _where(graph: Graph, condition: Any, yes: Any, no: Any) -> Scalar:
    return where(graph.scalar(condition), graph.scalar(yes), graph.scalar(no))


def _interpolate(graph: Graph, x: Scalar, knots: list[float], values: list[float]) -> Scalar:
    """Piecewise linear function, constant beyond its ends, as a sum of clipped ramps."""
    total = graph.constant(values[0])
    for low, high, here, there in zip(knots[:-1], knots[1:], values[:-1], values[1:], strict=True):
        ramp = binary("minimum", binary("maximum", (x - low) / (high - low), graph.constant(0.0)), graph.constant(1.0))
        total = total + (there - here) * ramp
    return total
