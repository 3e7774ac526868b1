"""Plug-in registry and lazily imported packages."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar, cast

from .errors import OptionError, shorten

Plugin = TypeVar("Plugin")


class Registry(Generic[Plugin]):
    """Plug-ins of one kind: modules of signid and entry points `signid.<kind>` of other packages, imported on access.

    A plug-in module defines `PLUGIN`. Its registered name is the module name without leading or trailing underscores.
    """

    def __init__(self, kind: str, package: str, names: str, unlisted: str = "") -> None:
        self.kind, self.package = kind, package
        self.modules = {name.strip("_"): name for name in names.split()}
        self.unlisted = {name.strip("_"): name for name in unlisted.split()}  # accessible by name, but not listed

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the plug-ins of signid, in the order of registration."""
        return tuple(self.modules)

    def __getitem__(self, name: str) -> Plugin:
        """Plug-in of a name.

        Raises:
            OptionError: unknown name.
        """
        if module := {**self.modules, **self.unlisted}.get(name):
            return cast(Plugin, import_module(f"{self.package}.{module}").PLUGIN)
        from importlib.metadata import entry_points  # slow import, needed only for other packages

        for point in entry_points(group=f"signid.{self.kind}"):
            if point.name == name:
                return cast(Plugin, point.load())
        parts = [known for known in self.names if name and name in known]
        close = parts[:3] or get_close_matches(name, self.names, n=3, cutoff=0.7)
        advice = f"did you mean {' or '.join(close)}?" if close else f"choose from {shorten(self.names)}"
        raise OptionError(f"there is no {self.kind.rstrip('s')} named {name!r}; {advice}")

    def __iter__(self) -> Iterator[Plugin]:
        return (self[name] for name in self.modules)


def public_names(package: str) -> dict[str, str]:
    """Public names of a package, mapped to their modules: the imports under `if TYPE_CHECKING` of its source."""
    source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    blocks = [node.body for node in ast.parse(source).body if isinstance(node, ast.If)]
    lines = [line for block in blocks for line in block if isinstance(line, ast.ImportFrom)]
    return {alias.name: f"{'.' * line.level}{line.module}" for line in lines for alias in line.names}


def package(name: str, homes: Mapping[str, str]) -> type[ModuleType]:
    """Module type of a package whose `public_names` are imported lazily.

    The names are properties, so `signid.identify` is the function although a module has the same name. `dir` lists
    them, for tab completion.
    """

    def listed(module: ModuleType) -> list[str]:
        return sorted({*homes, *(key for key in vars(module) if key.startswith("__"))})

    lazy = {public: _lazy(public, home, name) for public, home in homes.items()}
    return type("Package", (ModuleType,), {"__dir__": listed, **lazy})


def become_package(name: str) -> dict[str, str]:
    """Make a module that is being imported a `package`, and return its `public_names`."""
    homes = public_names(name)
    sys.modules[name].__class__ = package(name, homes)
    return homes


def inner_package(name: str, homes: Mapping[str, str]) -> type[ModuleType]:
    """Module type of a subpackage: like `package`, and reading `__all__` imports all public names."""

    def everything(module: ModuleType) -> list[str]:
        vars(module).update({public: getattr(module, public) for public in homes})
        return list(homes)

    return type("InnerPackage", (package(name, homes),), {"__all__": property(everything)})


def _lazy(name: str, home: str, package: str) -> property:
    return property(lambda _: getattr(import_module(home, package), name), lambda _, module: None)
