"""A set of public recordings: its repository, licence, source files and converted files."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from ...errors import OptionError

_PLAIN = re.compile(r"\w[\w.+-]*")  # file names without a path
UNSTATED = "none stated (all rights reserved)"


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

    def __post_init__(self) -> None:
        files = [*(product.name for product in self.products), *(name for name, _ in self.carried)]
        paths = [self.repository, *self.sources, *(path for _, path in self.carried)]
        for name in (self.name, self.folder, *files, *(part for path in paths for part in path.split("/"))):
            if not _PLAIN.fullmatch(name):
                fault = f"has a file or folder named {name!r}; give a name without a path"
                raise OptionError(f"data set {self.name} {fault}")

    @property
    def sources(self) -> tuple[str, ...]:
        """Paths of all files to download, without repetitions."""
        return tuple(dict.fromkeys(path for product in self.products for path in product.sources))

    @property
    def base(self) -> str:
        """Base address of the source files."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}"

    @property
    def home(self) -> str:
        """Web page of the repository at the commit."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"
