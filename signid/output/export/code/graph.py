"""Expressions as a graph without repetitions: constants folded, zeros and ones removed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

Node = tuple[Any, ...]  # ("variable", name) | ("constant", x) | (operation, number of a node, ...)

UNARY: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arctan": math.atan,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "abs": abs,
    "sign": lambda x: float((x > 0) - (x < 0)),
}
BINARY: dict[str, Callable[[float, float], float]] = {
    "minimum": min,
    "maximum": max,
    "arctan2": math.atan2,
    "power": math.pow,
    "greater": lambda a, b: float(a > b),
}
MAX_PRODUCT_EXPONENT = 4  # largest exponent that is written as products


@dataclass
class Graph:
    """Nodes in the order in which they can be computed; equal ones are one."""

    nodes: list[Node] = field(default_factory=list)
    numbers: dict[Node, int] = field(default_factory=dict)
    section: str = ""  # what is being computed, for comments
    sections: list[str] = field(default_factory=list)  # of the nodes

    def add(self, node: Node) -> Scalar:
        """Node of the graph, new unless there is an equal one."""
        if node not in self.numbers:
            self.numbers[node] = len(self.nodes)
            self.nodes.append(node)
            self.sections.append(self.section)
        return Scalar(self, self.numbers[node])

    def variable(self, name: str) -> Scalar:
        """Input of the program."""
        return self.add(("variable", name))

    def constant(self, x: float) -> Scalar:
        """Number; -0 counts as 0."""
        return self.add(("constant", float(x) + 0.0))

    def scalar(self, x: Any) -> Scalar:
        """Node of a float; a node itself."""
        return x if isinstance(x, Scalar) else self.constant(float(x))

    def used(self, outputs: Iterable[Scalar]) -> list[int]:
        """Numbers of the nodes that some outputs need, in the order in which they can be computed."""
        seen: set[int] = set()
        stack = [output.number for output in outputs]
        while stack:
            number = stack.pop()
            if number not in seen:
                seen.add(number)
                stack += operands(self.nodes[number])
        return sorted(seen)


def operands(node: Node) -> tuple[int, ...]:
    """Numbers of the nodes that a node is computed from."""
    return () if node[0] in ("variable", "constant") else node[1:]


@dataclass(frozen=True, eq=False)
class Scalar:
    """A node with the operators of a float, so that equations are written as for floats."""

    graph: Graph
    number: int

    @property
    def node(self) -> Node:
        return self.graph.nodes[self.number]

    @property
    def value(self) -> float | None:
        """Value of a constant, None for others."""
        return float(self.node[1]) if self.node[0] == "constant" else None

    def __add__(self, other: Any) -> Scalar:
        a, b = self, self.graph.scalar(other)
        if a.value is not None and b.value is not None:
            return a.graph.constant(a.value + b.value)
        if a.value == 0 or b.value == 0:
            return b if a.value == 0 else a
        for x, y in ((a, b), (b, a)):
            if y.node[0] == "negate":
                return _difference(x, Scalar(x.graph, y.node[1]))
        if _scale(b) < 0:
            return _difference(a, -b)
        if _scale(a) < 0:
            return _difference(b, -a)
        return a.graph.add(("add", *sorted((a.number, b.number))))

    def __radd__(self, other: Any) -> Scalar:
        return self.graph.scalar(other) + self

    def __sub__(self, other: Any) -> Scalar:
        return self + -self.graph.scalar(other)

    def __rsub__(self, other: Any) -> Scalar:
        return self.graph.scalar(other) + -self

    def __mul__(self, other: Any) -> Scalar:
        a, b = self, self.graph.scalar(other)
        if b.value is not None:
            a, b = b, a
        if a.value is None:
            for x, y in ((a, b), (b, a)):
                if x.node[0] == "negate":
                    return -(Scalar(x.graph, x.node[1]) * y)
            return a.graph.add(("multiply", *sorted((a.number, b.number))))
        if b.value is not None:
            return a.graph.constant(a.value * b.value)
        if a.value in (0.0, 1.0, -1.0):
            return a if a.value == 0 else b if a.value == 1 else -b
        if b.node[0] == "negate":
            return -a * Scalar(b.graph, b.node[1])
        if b.node[0] == "multiply" and b.graph.nodes[b.node[1]][0] == "constant":
            return a.graph.constant(a.value * b.graph.nodes[b.node[1]][1]) * Scalar(b.graph, b.node[2])
        return a.graph.add(("multiply", a.number, b.number))

    def __rmul__(self, other: Any) -> Scalar:
        return self.graph.scalar(other) * self

    def __truediv__(self, other: Any) -> Scalar:
        divisor = self.graph.scalar(other)
        if divisor.value is not None:
            return self * (1.0 / divisor.value)
        return self.graph.constant(0.0) if self.value == 0 else self.graph.add(("divide", self.number, divisor.number))

    def __rtruediv__(self, other: Any) -> Scalar:
        return self.graph.scalar(other) / self

    def __neg__(self) -> Scalar:
        if self.value is not None:
            return self.graph.constant(-self.value)
        operation, *inner = self.node
        if operation == "negate":
            return Scalar(self.graph, inner[0])
        if operation == "subtract":
            return self.graph.add(("subtract", inner[1], inner[0]))
        if operation == "multiply" and self.graph.nodes[inner[0]][0] == "constant":
            return self.graph.constant(-self.graph.nodes[inner[0]][1]) * Scalar(self.graph, inner[1])
        return self.graph.add(("negate", self.number))

    def __pow__(self, exponent: Any) -> Scalar:
        power = self.graph.scalar(exponent).value
        if power is not None and power == int(power) and 0 < power <= MAX_PRODUCT_EXPONENT:
            product = self
            for _ in range(int(power) - 1):
                product = product * self
            return product
        return binary("power", self, self.graph.scalar(exponent))

    def __abs__(self) -> Scalar:
        return unary("abs", self)

    def __gt__(self, other: Any) -> Scalar:
        return binary("greater", self, self.graph.scalar(other))

    def __lt__(self, other: Any) -> Scalar:
        return binary("greater", self.graph.scalar(other), self)


def unary(operation: str, x: Scalar) -> Scalar:
    """One of `UNARY` of a node."""
    if x.value is not None:
        return x.graph.constant(UNARY[operation](x.value))
    return x.graph.add((operation, x.number))


def binary(operation: str, a: Scalar, b: Scalar) -> Scalar:
    """One of `BINARY` of two nodes."""
    if a.value is not None and b.value is not None:
        return a.graph.constant(BINARY[operation](a.value, b.value))
    return a.graph.add((operation, a.number, b.number))


def where(condition: Scalar, yes: Scalar, no: Scalar) -> Scalar:
    """`yes` where the condition is not 0, else `no`."""
    if condition.value is not None:
        return yes if condition.value else no
    return yes if yes.number == no.number else yes.graph.add(("where", condition.number, yes.number, no.number))


def _difference(a: Scalar, b: Scalar) -> Scalar:
    if a.number == b.number:
        return a.graph.constant(0.0)
    return a.graph.add(("subtract", a.number, b.number))


def _scale(x: Scalar) -> float:
    """Constant factor of a node, 1 if it has none."""
    if x.node[0] != "multiply":
        return 1.0
    first = x.graph.nodes[x.node[1]]
    return float(first[1]) if first[0] == "constant" else 1.0
