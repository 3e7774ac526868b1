"""Docstrings of public names: shapes and units of arrays, and the errors raised.

An array is documented by a line `name: (N, n) [rad or m]`, in the docstring or beside a field; `[1]` has no dimension.
An override is documented where the method was first documented.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from sources import parsed

PACKAGE = Path(__file__).parents[1] / "signid"
TERM = r"(?:\.{3}|\w+(?:\s*[-+*/]\s*\w+)*)"
SHAPE = rf"\((?:{TERM}\s*,\s*)+(?:{TERM})?\)|\(\.{{3}}\)|\(\)"
UNIT = r"\[[^\]]+\]"
WITHOUT_UNIT = {"bool_", "intp", "int_", "int8", "int64", "integer", "uint8", "str_"}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Class:
    """Methods that an override may inherit its documentation from."""

    bases: tuple[str, ...]
    docstrings: Mapping[str, str]  # of its own methods


Classes = Mapping[str, Class]


def classes(trees: Iterator[ast.Module]) -> Classes:
    """Every class of the package by name."""
    return {
        node.name: Class(
            tuple(ast.unparse(base).split("[")[0].split(".")[-1] for base in node.bases),
            {f.name: ast.get_docstring(f) or "" for f in node.body if isinstance(f, Function)},
        )
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }


def inherited(name: str, bases: tuple[str, ...], known: Classes) -> str:
    for base in bases:
        if base in known:
            text = known[base].docstrings.get(name) or inherited(name, known[base].bases, known)
            if text:
                return text
    return ""


def kinds(annotation: ast.expr | None) -> set[str]:
    """Names in an annotation, those inside Callable[...] left out."""
    if annotation is None:
        return set()
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value).endswith("Callable"):
        return set()
    here = {annotation.id} if isinstance(annotation, ast.Name) else set()
    here |= {annotation.attr} if isinstance(annotation, ast.Attribute) else set()
    return here.union(*(kinds(part) for part in ast.iter_child_nodes(annotation) if isinstance(part, ast.expr)))


def lacks(name: str, annotation: ast.expr | None, text: str) -> str:
    """Missing information about an array, or "". Truth values and indices have no unit."""
    found = kinds(annotation)
    if not found & {"Array", "NDArray"}:
        return ""
    plain = found & WITHOUT_UNIT and "Array" not in found
    wanted = rf"(?<!\w){name}(?!\w).*?(?:{SHAPE})" + ("" if plain else rf".*?{UNIT}")
    if any(re.search(wanted, line) for line in text.splitlines()):
        return ""
    return f"{name} needs `{name}: (shape)`" if plain else f"{name} needs `{name}: (shape) [unit]`"


def raised(function: Function) -> set[str]:
    """Names of the errors in its raise statements; NotImplementedError is ignored."""
    errors = (node.exc for node in ast.walk(function) if isinstance(node, ast.Raise) and node.exc)
    names = (ast.unparse(error.func if isinstance(error, ast.Call) else error) for error in errors)
    return {name.split(".")[-1] for name in names if name.endswith("Error")} - {"NotImplementedError"}


def is_short_property(function: Function) -> bool:
    return any("property" in ast.unparse(d) for d in function.decorator_list) and len(function.body) == 1


def in_function(function: Function, text: str) -> Iterator[str]:
    text = ast.get_docstring(function) or text
    if not text:
        if not is_short_property(function):
            yield "has no docstring"
        return
    arguments = function.args
    for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg):
        if argument and (lack := lacks(argument.arg, argument.annotation, text)):
            yield lack
    section = text.partition("Raises:")[2]
    yield from (f"`Raises:` does not name {error}" for error in sorted(raised(function)) if error not in section)


def in_class(node: ast.ClassDef, lines: list[str], known: Classes) -> Iterator[tuple[int, str]]:
    text = ast.get_docstring(node)
    if not text:
        yield node.lineno, f"{node.name} has no docstring"
    for part in node.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name) and part.target.id[0] != "_":
            beside = " ".join(line.partition("#")[2] for line in lines[part.lineno - 1 : part.end_lineno])
            lack = lacks(part.target.id, part.annotation, f"{text or ''}\n{part.target.id}: {beside}")
            if lack:
                yield part.lineno, f"{node.name}: {lack}"
        elif isinstance(part, Function) and part.name[0] != "_":
            above = inherited(part.name, known[node.name].bases, known)
            yield from ((part.lineno, f"{node.name}.{part.name} {lack}") for lack in in_function(part, above))


def failures(source: str, tree: ast.Module, known: Classes) -> Iterator[tuple[int, str]]:
    """Line and message of each undocumented public name."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and node.name[0] != "_":
            yield from in_class(node, source.splitlines(), known)
        elif isinstance(node, Function) and node.name[0] != "_":
            yield from ((node.lineno, f"{node.name} {lack}") for lack in in_function(node, ""))


def test_public_names_are_documented() -> None:
    trees = {path: parsed(path) for path in sorted(PACKAGE.rglob("*.py"))}
    known = classes(iter(trees.values()))
    found = [f"{p}:{line}: {what}" for p, tree in trees.items() for line, what in failures(p.read_text(), tree, known)]
    assert not found, "\n" + "\n".join(found)


PLANTED = '''
def bare(): ...
def undocumented(q: Array):
    """Do it to q (all of it)."""
def unitless(q: NDArray[np.float64] | None):
    """q: (N, n) positions."""
def silent(q: float):
    """Judge."""
    raise RobotError("no")
class Kind:
    """A kind."""
    value: Array  # (n,)
    def run(self): ...
'''

DOCUMENTED = '''
def full(q: Array, mask: NDArray[np.bool_], f: Callable[[Array], Array]):
    """Do it.

    Args:
        q: (N, n) [rad or m] positions.
        mask: (2n + 1,) which of them.
        f: a function.

    Raises:
        RobotError: when it cannot.
    """
    raise RobotError("no")
def _private(q: Array): ...
class Base:
    """A base."""
    value: Array  # (..., m) [1]
    def run(self, q: Array):
        """Run; q: (n,) [rad]."""
    @property
    def short(self): return 1
class Child(Base):
    """A child; other (b,) [N.m]."""
    other: Array
    def run(self, q: Array): ...
    def __len__(self): ...
'''


def test_planted_omissions_are_caught() -> None:
    tree = ast.parse(PLANTED)
    found = [what for _, what in failures(PLANTED, tree, classes(iter([tree])))]
    assert found == [
        "bare has no docstring",
        "undocumented q needs `q: (shape) [unit]`",
        "unitless q needs `q: (shape) [unit]`",
        "silent `Raises:` does not name RobotError",
        "Kind: value needs `value: (shape) [unit]`",
        "Kind.run has no docstring",
    ]


def test_complete_documentation_passes() -> None:
    tree = ast.parse(DOCUMENTED)
    assert list(failures(DOCUMENTED, tree, classes(iter([tree])))) == []
