"""Data sets of the gallery, listed in sets.toml: repositories, licences, files and digests."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from . import convert


@dataclass(frozen=True)
class Product:
    """A file that is converted from source files."""

    name: str
    sources: tuple[str, ...]  # paths in the repository, in the order of the arguments of `make`
    make: Callable[..., str]
    sha256: str  # expected digest of the text before compression


@dataclass(frozen=True)
class DataSet:
    """Public recordings at one commit of a repository on GitHub."""

    name: str
    title: str
    folder: str
    seconds: float  # duration of all recordings [s]
    repository: str  # OWNER/NAME
    commit: str
    licence: str
    cite: str
    megabytes: float  # approximate download size
    products: tuple[Product, ...]
    carried: tuple[tuple[str, str], ...] = ()  # files that come with signid: name, and path below robots/
    example: str = ""  # command of an example, with {folder} and {robots}; empty: robots/NAME/identify.py
    drives: bool = False  # commands and positions of position drives, instead of torques or motor currents

    @property
    def sources(self) -> tuple[str, ...]:
        """Paths of all files to download, without repetitions."""
        return tuple(dict.fromkeys(path for product in self.products for path in product.sources))

    @property
    def base(self) -> str:
        """Base address of the source files."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}"


def _data_set(name: str, entry: dict[str, Any]) -> DataSet:
    products, carried = tuple(map(_product, entry.pop("files"))), tuple(entry.pop("carried", {}).items())
    return DataSet(name=name, products=products, carried=carried, **entry)


def _product(entry: Mapping[str, Any]) -> Product:
    make = partial(getattr(convert, entry["make"]), **entry.get("options", {}))
    return Product(entry["name"], tuple(entry["sources"]), make, entry["sha256"])


_LISTED = tomllib.loads(Path(__file__).with_name("sets.toml").read_text(encoding="utf-8"))
SETS = {name: _data_set(name, entry) for name, entry in _LISTED.items()}
