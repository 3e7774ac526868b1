"""Laws of a model as expressions, from the equations of their effects."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ....effects.naming import law_name
from ....model import Model, torque_model
from ....types import Law
from ..formats import EMPIRICAL_VARIABLES, writable
from .graph import BINARY, UNARY, Graph, Scalar, binary, unary, where
from .rigid import Expressions

OPERATIONS: dict[type[ast.AST], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Gt: operator.gt,
    ast.Lt: operator.lt,
}
SIGN_FUNCTION = "sign of velocity"  # function in the place of sign(v)


def law_expressions(
    graph: Graph, model: Model, motion: Mapping[str, Expressions], tracking: tuple[Expressions, Scalar] | None = None
) -> Expressions:
    """Torque (n,) of the laws that can be written.

    motion: "q", "v", "a" and "load" (n,) [rad or m, and their derivatives; N.m or N]. tracking: desired velocity (n,)
    [rad/s or m/s] and inverse width of smoothing, or None. With them, a law f(v, sign(v)) is f(v, 0) + f(v_desired, s)
    - f(v_desired, 0), s = tanh(v_desired / width): the part that jumps with the sign of v depends on v_desired alone.
    """
    total = np.array([graph.constant(0.0)] * len(model.robot.joints))
    for law in filter(writable, torque_model(model).laws):
        joints = list(law.joints)
        single = len(joints) == 1
        graph.section = law_name(law, model.robot)
        here = joints[0] if single else joints
        signals = {key: x[here] for key, x in motion.items()}
        if tracking is None:
            torque = _evaluate(graph, law, signals)
        else:
            smooth, none = partial(_smooth_sign, tracking[1]), partial(_no_sign, graph)
            desired = {**signals, "v": tracking[0][here]}
            jump = _evaluate(graph, law, desired, smooth) - _evaluate(graph, law, desired, none)
            torque = _evaluate(graph, law, signals, none) + jump
        for row, joint in enumerate(joints):
            total[joint] = total[joint] + (torque if single else torque[row])
    return total


def directed_laws(
    graph: Graph, model: Model, motion: Mapping[str, Expressions], slow: Expressions
) -> tuple[Expressions, Expressions]:
    """Torque (n,) of the laws, the sign of v proportional to it below `slow`, and size (n,) of friction that reverses.

    motion: "q", "v", "a" and "load" (n,), as in `law_expressions`; slow: (n,) [rad/s or m/s].
    """
    total, reversing = np.full((2, len(slow)), graph.constant(0.0))
    for law in filter(writable, torque_model(model).laws):
        graph.section = law_name(law, model.robot)
        joints = list(law.joints)
        here = joints[0] if len(joints) == 1 else joints
        signals = {key: x[here] for key, x in motion.items()}
        torque = _evaluate(graph, law, signals, partial(_direction, graph, sum(slow[joints])))
        total[joints] = total[joints] + torque
        if law.effect.reverses:
            side = partial(_side, graph)
            fast = np.array([side(motion["v"][j]) * binary("maximum", abs(motion["v"][j]), slow[j]) for j in joints])
            torque = _evaluate(graph, law, {**signals, "v": fast[0] if len(joints) == 1 else fast}, side)
            reversing[joints] = reversing[joints] + np.abs(torque)
    return total, reversing


def _direction(graph: Graph, slow: Scalar, x: Scalar) -> Scalar:
    """Direction of a velocity [1]: its sign, proportional to it below `slow`."""
    return _clip(x / slow, graph.constant(-1.0), graph.constant(1.0))


def _side(graph: Graph, x: Scalar) -> Scalar:
    """Sign of a velocity [1] that is never 0."""
    return where(graph.constant(0.0) > x, graph.constant(-1.0), graph.constant(1.0))


def _evaluate(
    graph: Graph, law: Law, signals: Mapping[str, Any], sign: Callable[[Scalar], Scalar] | None = None
) -> Any:
    """Torque of a law; sign: in the place of the sign of a velocity and of a tanh that stands for one."""
    numbers: dict[str, Any] = {key: float(x) for key, x in law.effect.filled(law.parameters).items()}
    if law.effect.name == "empirical":
        lists = {key + "s": [x for k, x in numbers.items() if k.startswith(f"{key}_")] for key in ("knot", "value")}
        numbers = {"variable": signals[EMPIRICAL_VARIABLES[int(numbers["variable"])]], **lists}
    functions: dict[str, Any] = {name: _lifted(graph, partial(unary, name), 1) for name in UNARY}
    functions |= {name: _lifted(graph, partial(binary, name), 2) for name in BINARY}
    functions |= {"where": _lifted(graph, where, 3), "clip": _lifted(graph, _clip, 3), "pi": np.pi}
    functions |= {"interp": partial(_interpolate, graph), "sum": sum}
    if sign is not None:
        functions[SIGN_FUNCTION] = np.frompyfunc(sign, 1, 1)
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
            return OPERATIONS[type(node.op)](_value(node.left, names), _value(node.right, names))
        case ast.Compare(ops=[ast.Gt() | ast.Lt()]):
            return OPERATIONS[type(node.ops[0])](_value(node.left, names), _value(node.comparators[0], names))
        case ast.Call() if SIGN_FUNCTION in names and (velocity := _signed_velocity(node)):
            return names[SIGN_FUNCTION](_value(velocity, names))
        case ast.Call():
            return _value(node.func, names)(*(_value(x, names) for x in node.args))
        case ast.Subscript():
            return _value(node.value, names)[::-1]
    raise ValueError(f"an equation with {ast.dump(node)} cannot be written as code")


def _smooth_sign(rate: Scalar, x: Scalar) -> Scalar:
    return unary("tanh", x * rate)


def _no_sign(graph: Graph, x: Scalar) -> Scalar:
    return graph.constant(0.0)


def _signed_velocity(call: ast.Call) -> ast.expr | None:
    """Velocity (or sum of two) x in sign(x), or in tanh(x / scale), which stands for it; None for other calls."""
    match call:
        case (
            ast.Call(func=ast.Name(id="sign"), args=[x])
            | ast.Call(func=ast.Name(id="tanh"), args=[ast.BinOp(left=x, op=ast.Div())])
        ):
            names = {part.id for part in ast.walk(x) if isinstance(part, ast.Name)}
            return x if "v" in names and names <= {"v", "sum"} else None
    return None


def _lifted(graph: Graph, function: Callable[..., Scalar], operands: int) -> Any:
    """A function of nodes as one of arrays of nodes and numbers."""
    return np.frompyfunc(lambda *given: function(*map(graph.scalar, given)), operands, 1)


def _interpolate(graph: Graph, x: Scalar, knots: list[float], values: list[float]) -> Scalar:
    """Piecewise linear function, constant beyond its ends, as a sum of clipped ramps."""
    total = graph.constant(values[0])
    for low, high, here, there in zip(knots[:-1], knots[1:], values[:-1], values[1:], strict=True):
        total = total + (there - here) * _clip((x - low) / (high - low), graph.constant(0.0), graph.constant(1.0))
    return total


def _clip(x: Scalar, low: Scalar, high: Scalar) -> Scalar:
    return binary("minimum", binary("maximum", x, low), high)
