"""Xacro's arguments, and a parser in place of xacro's: no document types, and a limited number of included files.

The restricted process of `sandbox` loads the module, which imports nothing from signid.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from xml.dom import expatbuilder

MOST_FILES, MOST_DEPTH = 500, 20  # largest number of included files (as of MJCF), and depth of files in files
MOST_LETTERS = 100_000_000  # of all included files together
MOST_NAMES = 20  # arguments that a sentence lists
DOCTYPE = "the file declares a document type, which could load other files; remove the <!DOCTYPE ...>"
ONE_ROBOT = "give the description of one robot"
_READ = re.compile(r"\$\(arg\s+([^\s()]+)\s*\)|\bxacro\.arg\(\s*['\"]([^'\"]+)['\"]")  # an argument that is read
_EVALUATED = re.compile(r"\$\(eval\b[^$]*")  # an expression that may name arguments


class Sentence(Exception):
    """A reason that is a sentence of its own."""


class Arguments(dict[str, str]):
    """Values of a xacro file's arguments; one that has no value is recorded, and its own name replaces it.

    One that is read before its declaration, as in <robot name="$(arg name)">, has its default.
    """

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.given, self.lacking = frozenset(given), list[str]()
        self.declared, self.required = list[str](), list[str]()  # by <xacro:arg> with a default, and without
        self.read, self.expressions = list[str](), list[str]()  # by $(arg NAME), and texts that may read others
        self.defaults = dict[str, str]()  # those without expressions

    def __missing__(self, name: str) -> str:
        if name in self.defaults:
            return self.defaults[name]
        self.lacking.append(name)
        return name

    def note(self, document: Any) -> None:
        """Record the arguments that a parsed file declares and reads; remove declarations without a default.

        Xacro refuses such a declaration even if the value is given.
        """
        for node in document.getElementsByTagName("xacro:arg"):
            whole = node.hasAttribute("default")
            (self.declared if whole else self.required).append(node.getAttribute("name"))
            if not whole:
                node.parentNode.removeChild(node)
            elif "$" not in (default := node.getAttribute("default")):
                self.defaults.setdefault(node.getAttribute("name"), default)
        for text in _texts(document.documentElement):
            self.read += [one or other for one, other in _READ.findall(text)]
            self.expressions += _EVALUATED.findall(text)

    def check(self) -> None:
        """Check that every argument that the expansion needs is given, and that every given one is an argument.

        Raises:
            Sentence: the names of those that are not.
        """
        self._check_lacking([])
        known = {*self.declared, *self.required, *self.read}
        words = {word for text in self.expressions for word in re.findall(r"[\w.]+", text)}
        if strange := sorted(self.given - known - words):
            listed = f"its arguments are {_listed(sorted(known))}" if known else "it has none, so leave --xacro out"
            raise Sentence(f"the xacro file has no argument {strange[0]!r}; {listed}")

    def explain(self, error: BaseException) -> BaseException:
        """Error of an expansion with what the file's arguments have to do with it."""
        cause = error
        while isinstance(inner := getattr(cause, "exc", None), Exception):  # of XacroException
            cause = inner
        if isinstance(cause, MemoryError) or (isinstance(cause, Sentence) and not self.lacking):
            return cause
        try:
            unread = [name for name in self.read if name not in self.declared]
            self._check_lacking(unread)
            self.check()
        except Sentence as sentence:
            return sentence
        if not (takes := sorted({*self.declared, *self.required, *self.read})):
            return error
        reason = str(error) or type(error).__name__
        if isinstance(cause, FileNotFoundError):
            if unknown := self._unknown_value(str(cause.filename), takes):
                return unknown
            reason = f"there is no {cause.filename}"
        elif isinstance(cause, PermissionError):
            reason = f"it may not read {cause.filename}, because {cause.strerror}"
        return ValueError(f"{reason}; its arguments are {_listed(takes)} (--xacro NAME:=VALUE)")

    def _unknown_value(self, path: str, names: Sequence[str]) -> Sentence | None:
        """Values that an argument may have, if it alone may have named the first part of a path that is not there."""
        missing, folder = path, os.path.dirname(path)
        while not os.path.isdir(folder) and folder != os.path.dirname(folder):
            missing, folder = folder, os.path.dirname(folder)
        whole = missing == path
        value, ending = os.path.splitext(os.path.basename(missing)) if whole else (os.path.basename(missing), "")
        named = [name for name in names if self.get(name) == value] or [
            name for name in names if self.get(name) and self[name] in value
        ]
        if not os.path.isdir(folder) or len(named) != 1:
            return None
        alike = [entry.name for entry in os.scandir(folder) if entry.is_dir() != whole and entry.name.endswith(ending)]
        there = _listed(sorted(name.removesuffix(ending) for name in alike)) or "none"
        stated = f"the xacro argument {named[0]} is {self[named[0]]!r}, but there is no {path}"
        return Sentence(f"{stated}; add --xacro {named[0]}:=VALUE (there are {there})")

    def _check_lacking(self, unread: Sequence[str]) -> None:
        """Raise if an argument had no value when it was read; the sentence also names the others that have none.

        `unread`: arguments without a default that a failed expansion may not have reached.
        """
        others = [name for name in (*self.required, *unread) if name not in self]
        names = [name for name in dict.fromkeys((*self.lacking, *others)) if name not in self.given]
        if self.lacking:
            noun = "the argument" if len(names) == 1 else "the arguments"
            options = " ".join(f"--xacro {name}:=VALUE" for name in names[:MOST_NAMES])
            raise Sentence(f"the xacro file needs {noun} {_listed(names)}; add {options}")


def strict_parser(arguments: Arguments) -> Callable[..., Any]:
    """Parser in place of xacro's, of a text, or of a file if its name is given.

    It raises Sentence for a document type, and if the files are too many, too large or too deep.
    """
    read = _limited_reader()

    def parse(text: Any, filename: str | None = None) -> Any:
        where = "" if filename is None else f"included file {os.path.basename(filename)}: "
        document = _Builder(where).parseString(text if filename is None else read(filename))
        arguments.note(document)
        return document

    return parse


def strict_names(absolute: Callable[[Any], str], absent_package: Callable[[object], str]) -> Callable[[Any], str]:
    """Function in place of xacro's that makes the names of included files and of YAML files absolute.

    It raises Sentence for a file of a package that is not there, also if the include is optional.
    """

    def complete(name: Any) -> str:
        if package := absent_package(name):
            reason = (
                f"xacro cannot expand it: it needs the ROS package {package!r}, which is neither above nor beside it"
            )
            raise Sentence(f"{reason}; add --package-dir DIR, the folder that holds the package")
        return absolute(name)

    return complete


class _Builder(expatbuilder.ExpatBuilderNS):
    """Builder of trees that ends at the beginning of a document type."""

    def __init__(self, where: str) -> None:
        super().__init__()
        self.where = where

    def start_doctype_decl_handler(self, *_: Any) -> None:
        raise Sentence(self.where + DOCTYPE)


def _limited_reader() -> Callable[[str], str]:
    """Reader of included files that counts them and their letters."""
    import xacro

    files, letters = 0, 0

    def read(path: str) -> str:
        nonlocal files, letters
        files, name = files + 1, os.path.basename(path)
        if files > MOST_FILES:
            raise Sentence(f"the file includes more than {MOST_FILES} files; {ONE_ROBOT}")
        if len(xacro.filestack or ()) > MOST_DEPTH:
            raise Sentence(f"{name} is included more than {MOST_DEPTH} files deep, as if by itself; remove an include")
        if os.path.exists(path) and not os.path.isfile(path):
            raise Sentence(f"included file {name}: it is no regular file; include a xacro file")
        try:
            with open(path, encoding="utf-8-sig") as stream:
                text = stream.read(MOST_LETTERS - letters + 1)
        except OSError as error:
            xacro.filestack.pop()
            raise xacro.XacroException(f"{error.strerror}: {error.filename}", exc=error) from None
        letters += len(text)
        if letters > MOST_LETTERS:
            raise Sentence(f"its files have more than {MOST_LETTERS / 1e6:.0f} MB; {ONE_ROBOT}")
        return text

    return read


def _texts(element: Any) -> list[str]:
    """Attributes and texts of an element and of all below it."""
    found, stack = list[str](), [element]
    while stack:
        node = stack.pop()
        if node.nodeType in (node.TEXT_NODE, node.CDATA_SECTION_NODE):
            found.append(node.data)
        elif node.nodeType == node.ELEMENT_NODE:
            found += [value for _, value in node.attributes.items()]
            stack += reversed(node.childNodes)
    return found


def _listed(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMES
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:MOST_NAMES])} and {more} more"
