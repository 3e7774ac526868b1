"""Expansion of xacro in the restricted process of `sandbox`, which loads the module; it imports nothing from signid.

Expressions are walked as a syntax tree (simpleeval): numbers, strings, lists, dictionaries, operators, the functions
that xacro documents, and listed methods. Python never evaluates them. A parser in place of xacro's refuses document
types and limits the number of included files. Packages, which xacro files name by $(find PACKAGE), are found without
an installation of ROS.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import io
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.dom import Node, expatbuilder

import simpleeval
import xacro
from xacro import substitution_args
from xacrodoc import XacroDoc
from xacrodoc.packages import PackageFinder, PackageNotFoundError

MAX_INCLUDED_FILES, MAX_DEPTH = 500, 20  # largest number of included files (as of MJCF), and depth of files in files
MAX_INCLUDED_LETTERS = 100_000_000  # of all included files together
MAX_LISTED_ARGUMENTS = 20  # arguments that a sentence lists
DOCTYPE_FAULT = "the file declares a document type, which could load other files; remove the <!DOCTYPE ...>"
ONE_ROBOT_ADVICE = "give the description of one robot"
_TEXT_NODES = (Node.TEXT_NODE, Node.CDATA_SECTION_NODE)
_ARGUMENT_READ = re.compile(r"\$\(arg\s+([^\s()]+)\s*\)|\bxacro\.arg\(\s*['\"]([^'\"]+)['\"]")
_EVALUATION = re.compile(r"\$\(eval\b[^$]*")  # an expression that may name arguments
ABSENT_PACKAGE = "package://"  # begins the text in place of the folder of a package that is not there
MANIFEST, OLD_MANIFEST = "package.xml", "manifest.xml"  # of ROS 1 and 2, of rosbuild
MAX_MANIFEST_LETTERS = 100_000  # part of a manifest that is searched for the name [characters]
PACKAGE_FOLDERS = frozenset("arms description grippers model models robot robots urdf xacro".split())
_WORD = re.compile(r"[A-Za-z][\w\-]*")
_STATED_NAME = re.compile(r"<name>\s*([\w\-]+)\s*</name>")


class Sentence(Exception):
    """A reason that is a sentence of its own."""


class Arguments(dict[str, str]):
    """Values of a xacro file's arguments; one that has no value is recorded, and its own name replaces it.

    One that is read before its declaration, as in <robot name="$(arg name)">, has its default.
    """

    def __init__(self, arguments: Mapping[str, str]) -> None:
        super().__init__(arguments)
        self.given, self.lacking = frozenset(arguments), list[str]()
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
        for node in document.getElementsByTagName("*"):
            texts = [part.data for part in node.childNodes if part.nodeType in _TEXT_NODES]
            for text in (*dict(node.attributes.items()).values(), *texts):
                self.read += [single or other for single, other in _ARGUMENT_READ.findall(text)]
                self.expressions += _EVALUATION.findall(text)

    def check(self) -> None:
        """Check that every argument that the expansion needs is given, and that every given one is an argument.

        Raises:
            Sentence: the names of those that are not.
        """
        self._check_lacking([])
        known = {*self.declared, *self.required, *self.read}
        words = {word for text in self.expressions for word in re.findall(r"[\w.]+", text)}
        if strange := sorted(self.given - known - words):
            listed = f"its arguments are {_shortlist(sorted(known))}" if known else "it has none, so leave --xacro out"
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
        return ValueError(f"{reason}; its arguments are {_shortlist(takes)} (--xacro NAME:=VALUE)")

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
        there = _shortlist(sorted(name.removesuffix(ending) for name in alike)) or "none"
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
            options = " ".join(f"--xacro {name}:=VALUE" for name in names[:MAX_LISTED_ARGUMENTS])
            raise Sentence(f"the xacro file needs {noun} {_shortlist(names)}; add {options}")


def expand(
    path: str, package_dirs: Sequence[str], given: Mapping[str, str], restrict: Callable[[Sequence[str]], None]
) -> str:
    """URDF of a xacro file; `restrict` gets the folders that may be read, which $(find) extends.

    Raises:
        Sentence: a reason that is a sentence of its own.
    """
    arguments = Arguments(given)
    named = filter(os.path.isfile, filter(os.path.isabs, arguments.values()))  # by the caller, not by the description
    folders = [os.path.dirname(os.path.abspath(path)), *package_dirs, *named]
    xacro.parse = strict_parser(arguments)
    xacro.abs_filename_spec = strict_names(xacro.abs_filename_spec)
    for name in ("type", "vars", "issubclass"):  # they reach classes and their attributes
        xacro._global_symbols["python"].pop(name, None)
    xacro.safe_eval, substitution_args._eval = _evaluate, _substitute
    substitution_args._eval_find = package_finder(path, package_dirs, folders.append)
    restrict(folders)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        try:
            text = str(XacroDoc.from_file(path, resolve_packages=False, subargs=arguments).dom.toxml())
        except (Exception, SystemExit) as error:
            raise arguments.explain(error) from None
    arguments.check()
    return text


class _Expression(simpleeval.EvalWithCompoundTypes):  # type: ignore[misc]
    """Syntax-tree evaluator with the names and attributes of a xacro file."""

    def __init__(self, names: Any) -> None:
        super().__init__(functions={})
        self.names = names
        for kind in (ast.JoinedStr, ast.FormattedValue, ast.Assign, ast.AugAssign):
            del self.nodes[kind]

    def _check_disallowed_items(self, item: Any) -> None:  # attributes and names are listed one by one
        pass

    def _eval_call(self, node: ast.Call) -> Any:
        function = self._eval(node.func)
        named = dict(self._eval(keyword) for keyword in node.keywords)
        return function(*self._eval_list(ast.List(node.args)), **named)

    def _eval_attribute(self, node: ast.Attribute) -> Any:
        owner, methods = self._eval(node.value), simpleeval.BASIC_ALLOWED_ATTRS
        if isinstance(owner, xacro.NameSpace | xacro.YamlDictWrapper) and node.attr not in methods[dict]:
            return owner[node.attr]
        kind = next((kind for kind in methods if kind is not None and isinstance(owner, kind)), None)
        if kind is None or node.attr not in methods[kind] or node.attr in simpleeval.DISALLOW_METHODS:
            raise simpleeval.FeatureNotAvailable(f"an expression may not use .{node.attr} here")
        return getattr(owner, node.attr)


def _evaluate(expression: str, names: Any, _: Any = None) -> Any:
    return _Expression(names).eval(expression)


def _substitute(expression: str, context: dict[str, Any]) -> str:
    """Value of $(eval EXPRESSION)."""
    arguments = context.get("arg", {})

    def value(name: str) -> Any:
        return substitution_args.convert_value(arguments[name], "auto")

    commands = {"arg": value, "dirname": lambda: os.path.dirname(context["filename"])}
    known = {k: v for k, v in substitution_args._eval_dict.items() if not k.startswith("_")}
    return str(_evaluate(expression, {**{name: value(name) for name in arguments}, **commands, **known}))


def strict_parser(arguments: Arguments) -> Callable[..., Any]:
    """Parser in place of xacro's, of a text, or of a file if its name is given.

    It raises Sentence for a document type, and if the files are too many, too large or too deep.
    """
    files, letters = 0, 0

    def read(path: str) -> str:
        nonlocal files, letters
        files, name = files + 1, os.path.basename(path)
        if files > MAX_INCLUDED_FILES:
            raise Sentence(f"the file includes more than {MAX_INCLUDED_FILES} files; {ONE_ROBOT_ADVICE}")
        if len(xacro.filestack or ()) > MAX_DEPTH:
            raise Sentence(f"{name} is included more than {MAX_DEPTH} files deep, as if by itself; remove an include")
        if os.path.exists(path) and not os.path.isfile(path):
            raise Sentence(f"included file {name}: it is no regular file; include a xacro file")
        try:
            with open(path, encoding="utf-8-sig") as stream:
                text = stream.read(MAX_INCLUDED_LETTERS - letters + 1)
        except OSError as error:
            xacro.filestack.pop()
            raise xacro.XacroException(f"{error.strerror}: {error.filename}", exc=error) from None
        letters += len(text)
        if letters > MAX_INCLUDED_LETTERS:
            raise Sentence(f"its files have more than {MAX_INCLUDED_LETTERS / 1e6:.0f} MB; {ONE_ROBOT_ADVICE}")
        return text

    def parse(text: Any, filename: str | None = None) -> Any:
        where = "" if filename is None else f"included file {os.path.basename(filename)}: "
        document = _Builder(where).parseString(text if filename is None else read(filename))
        arguments.note(document)
        return document

    return parse


class _Builder(expatbuilder.ExpatBuilderNS):
    """Builder of trees that ends at the beginning of a document type."""

    def __init__(self, where: str) -> None:
        super().__init__()
        self.where = where

    def start_doctype_decl_handler(self, *_: Any) -> None:
        raise Sentence(self.where + DOCTYPE_FAULT)


def strict_names(absolute: Callable[[Any], str]) -> Callable[[Any], str]:
    """Function in place of xacro's that makes the names of included files and of YAML files absolute.

    It raises Sentence for a file of a package that is not there, also if the include is optional.
    """

    def complete(name: Any) -> str:
        if (text := str(name)).startswith(ABSENT_PACKAGE):
            package = text.removeprefix(ABSENT_PACKAGE).partition("/")[0]
            reason = (
                f"xacro cannot expand it: it needs the ROS package {package!r}, which is neither above nor beside it"
            )
            raise Sentence(f"{reason}; add --package-dir DIR, the folder that holds the package")
        return absolute(name)

    return complete


def _shortlist(names: Sequence[str]) -> str:
    more = len(names) - MAX_LISTED_ARGUMENTS
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:MAX_LISTED_ARGUMENTS])} and {more} more"


def package_finder(path: str, package_dirs: Sequence[str], allow: Callable[[str], None]) -> Callable[[str], str]:
    """Finder of a package's folder by its name, for the description in `path`.

    A package is a folder with a manifest that states the name. It is searched in the given folders, above and beside
    the description, and where ROS is installed. A folder without a manifest counts if its own name is that of the
    package and it is in a given folder, or above the description and looks like a package. `allow` gets the folder
    that is found. The name of a package that is not there becomes ABSENT_PACKAGE and the name, as meshes have it.
    """
    place = Path(os.path.abspath(path))
    above, folders = place.parents, [Path(folder) for folder in package_dirs]

    def candidates(name: str) -> Iterator[Path]:
        for folder in folders:
            yield from (at for at in (folder, folder / name) if _states_package(at, name))
            yield from (at for at in (folder, folder / name) if at.name == name and at.is_dir())
            yield from _find_below(folder, name)
        yield from (folder for folder in above if _states_package(folder, name))
        yield from (folder for folder in above if folder.name == name and _is_package_folder(folder, place))
        yield from (folder / name for folder in above if _states_package(folder / name, name))
        prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
        shares = (Path(prefix, "share", name) for prefix in prefixes)
        yield from (share for share in shares if _states_package(share, name))
        yield from _find_below(None, name)

    @functools.cache
    def find(name: str) -> str:
        found = next(candidates(name), None) if _WORD.fullmatch(name) else None
        if found is None:
            return ABSENT_PACKAGE + name
        allow(str(found))
        return found.as_posix()

    return find


def _states_package(folder: Path, name: str) -> bool:
    """Whether a folder has a manifest that states the name of the package; rosbuild's is named by its folder."""
    try:
        with open(folder / MANIFEST, encoding="utf-8", errors="replace") as stream:
            stated = _STATED_NAME.search(stream.read(MAX_MANIFEST_LETTERS))
    except OSError:
        return folder.name == name and (folder / OLD_MANIFEST).is_file()
    return bool(stated and stated.group(1) == name)


def _is_package_folder(folder: Path, file: Path) -> bool:
    """Whether a folder above a file is no other one of the computer: it has a _ and the layout of a ROS package."""
    home = Path.home()
    usual = "_" in folder.name and file.relative_to(folder).parts[0] in PACKAGE_FOLDERS
    return usual and folder != home and folder not in home.parents


def _find_below(folder: Path | None, name: str) -> Iterator[Path]:
    """The package somewhere below a folder, or in ROS_PACKAGE_PATH."""
    finder = PackageFinder()
    if folder is not None:
        finder.look_in([str(folder)])
    with contextlib.suppress(PackageNotFoundError, OSError):
        yield Path(finder.get_path(name))
