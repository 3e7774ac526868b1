"""One registry for every kind of plug-in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from importlib import import_module
from types import ModuleType
from typing import Generic, TypeVar, cast

from .errors import OptionError, shorten

Plugin = TypeVar("Plugin")


class Registry(Generic[Plugin]):
    """Names of modules in the tree, or entry points `signid.<kind>` of other packages; imported when asked for.

    A plug-in module ends in `PLUGIN = ...`; its name in the registry is the module's, without underscores at its ends.
    """

    def __init__(self, kind: str, package: str, names: str, unlisted: str = "") -> None:
        self.kind, self.package = kind, package
        self.modules = {name.strip("_"): name for name in names.split()}
        self.unlisted = {name.strip("_"): name for name in unlisted.split()}  # found by name, offered nowhere

    @property
    def names(self) -> tuple[str, ...]:
        """Names that the tree itself carries, in the order of registration."""
        return tuple(self.modules)

    def __getitem__(self, name: str) -> Plugin:
        """The plug-in of that name.

        Raises:
            OptionError: when neither the tree nor an installed package has it.
        """
        if module := {**self.modules, **self.unlisted}.get(name):
            return cast(Plugin, import_module(f"{self.package}.{module}").PLUGIN)
        from importlib.metadata import entry_points  # here, because what the tree itself carries does not need it

        for point in entry_points(group=f"signid.{self.kind}"):
            if point.name == name:
                return cast(Plugin, point.load())
        parts = [known for known in self.names if name and name in known]
        close = parts[:3] or get_close_matches(name, self.names, n=3, cutoff=0.7)
        advice = f"did you mean {' or '.join(close)}?" if close else f"choose from {shorten(self.names)}"
        raise OptionError(f"there is no {self.kind.rstrip('s')} named {name!r}; {advice}")

    def __iter__(self) -> Iterator[Plugin]:
        return (self[name] for name in self.modules)


def package(homes: Mapping[str, str]) -> type[ModuleType]:
    """What a package is whose public names are imported from the modules that are their homes when first used.

    They are properties, so that `signid.identify` is the verb although a module has its name.
    """
    names = {name: _public(name, home) for home, names in homes.items() for name in names.split()}
    return type("Package", (ModuleType,), names)


def inner_package(homes: Mapping[str, str]) -> type[ModuleType]:
    """The same of a package within the package, all of whose names are imported when its `__all__` is asked for."""

    def everything(module: ModuleType) -> list[str]:
        names = [name for names in homes.values() for name in names.split()]
        vars(module).update({name: getattr(module, name) for name in names})
        return names

    return type("InnerPackage", (package(homes),), {"__all__": property(everything)})


def _public(name: str, home: str) -> property:
    return property(lambda _: getattr(import_module(f"{__package__}.{home}"), name), lambda _, module: None)
