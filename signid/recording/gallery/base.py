"""What a data set is: where its files come from, and what signid makes of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from ...errors import OptionError
from ...registry import Registry

_PLAIN = re.compile(r"\w[\w.+-]*")  # a name that cannot leave its folder
UNSTATED = "none stated (all rights reserved)"


@dataclass(frozen=True)
class Product:
    """A file that signid makes of files of the source."""

    name: str
    sources: tuple[str, ...]  # paths in the repository, in the order in which `make` takes their bytes
    make: Callable[..., str]
    sha256: str  # of its text, before it is compressed: a download that makes another text is refused


@dataclass(frozen=True)
class DataSet:
    """Recordings that are public at one commit of a repository on GitHub."""

    name: str
    title: str
    folder: str
    seconds: float  # of all recordings [s]
    repository: str  # OWNER/NAME
    commit: str
    licence: str
    cite: str
    megabytes: float  # about, to download
    products: tuple[Product, ...]
    carried: tuple[tuple[str, str], ...] = ()  # name of a file, and its path below robots/, where signid carries it
    example: str = ""  # a command; empty: robots/NAME/identify.py

    def __post_init__(self) -> None:
        files = [*(product.name for product in self.products), *(name for name, _ in self.carried)]
        paths = [self.repository, *self.sources, *(path for _, path in self.carried)]
        for name in (self.name, self.folder, *files, *(part for path in paths for part in path.split("/"))):
            if not _PLAIN.fullmatch(name):
                raise OptionError(f"data set {self.name} names a file or folder {name!r}; give a name without a path")

    @property
    def sources(self) -> tuple[str, ...]:
        """Paths of all files to download, each once."""
        return tuple(dict.fromkeys(path for product in self.products for path in product.sources))

    @property
    def base(self) -> str:
        """The address that these paths continue."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}"

    @property
    def home(self) -> str:
        """A page that shows the repository at that commit."""
        return f"https://github.com/{self.repository}/tree/{self.commit}"


DATA: Registry[DataSet] = Registry("data", __package__, "_1r _3r emps panda tx40 ur10e")
