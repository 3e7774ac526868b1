"""A data set from its public source: downloaded, converted, checked."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Mapping
from hashlib import sha256
from typing import TYPE_CHECKING
from urllib.parse import quote, urlsplit

from ...errors import DownloadError, OptionError
from ...robot.locate import robots_folder
from ...version import __version__
from .base import DataSet, Product
from .download import USUAL, Patience, download, is_allowed

if TYPE_CHECKING:
    from ...types import Progress


def fetch(
    wanted: DataSet,
    source: str | None = None,
    patience: Patience = USUAL,
    progress: Progress | None = None,
) -> dict[str, bytes]:
    """The files of a data set by name, ready to be written into its folder. Nothing is written here.

    Args:
        wanted: the data set.
        source: the address of a copy of the repository at that commit; by default GitHub's.
        patience: what is too large or too slow.
        progress: told what is being done, and the share of it that is done.

    Raises:
        OptionError: the source is neither https nor of this machine.
        DownloadError: a file cannot be had, or what is made of it is not what it should be.
    """
    base = wanted.base if source is None else check_source(source)
    raw = {
        path: download(f"{base}/{quote(path)}", patience, _share(progress, wanted, k))
        for k, path in enumerate(wanted.sources)
    }
    made = {product.name: _make(product, raw, wanted, base) for product in wanted.products}
    carried = {name: (robots_folder() / path).read_bytes() for name, path in wanted.carried}
    return {**made, **carried, f"source_{wanted.name}.txt": _note(wanted, base).encode()}


def _share(progress: Progress | None, wanted: DataSet, done: int) -> Callable[[float], None]:
    """Turns the share of one file into that of all."""

    def tell(share: float) -> None:
        if progress is not None:
            progress(f"downloading {wanted.name}", (done + share) / len(wanted.sources))

    return tell


def check_source(source: str) -> str:
    """The address of a copy of a repository, without a slash at its end.

    Raises:
        OptionError: it is neither https nor of this machine.
    """
    if not is_allowed(source, local=True) or urlsplit(source).query or urlsplit(source).fragment:
        told = "give https://HOST/PATH, or http://localhost:PORT for a server on this machine"
        raise OptionError(f"--source {source!r} is no address to download from; {told}")
    return source.rstrip("/")


def _make(product: Product, raw: Mapping[str, bytes], wanted: DataSet, base: str) -> bytes:
    try:
        text = product.make(*(raw[path] for path in product.sources)).encode()
    except Exception as error:  # whatever a reader says of a file that is not what it should be
        raise DownloadError(_other(product, wanted, base, f"cannot be read ({error})")) from error
    digest = sha256(text).hexdigest()
    if digest != product.sha256:
        told = f"is another (sha256 {digest[:12]}... instead of {product.sha256[:12]}...)"
        raise DownloadError(_other(product, wanted, base, told))
    return gzip.compress(text, mtime=0) if product.name.endswith(".gz") else text


def _other(product: Product, wanted: DataSet, base: str, what: str) -> str:
    mend = f"try again, or name a copy of the repository at commit {wanted.commit[:12]} by --source URL"
    return f"{product.name} from {base} {what}; nothing was written; {mend}"


def _note(wanted: DataSet, base: str) -> str:
    lines = [
        f"{wanted.name}: {wanted.title}",
        f"repository: https://github.com/{wanted.repository}",
        f"commit: {wanted.commit}",
        f"downloaded from: {base}",
        f"licence: {wanted.licence}",
        f"please cite: {wanted.cite}",
        f"made by signid {__version__} (sha256 of the text, before it is compressed):",
        *(f"  {product.sha256}  {product.name} <- {', '.join(product.sources)}" for product in wanted.products),
        *(f"  {name}: comes with signid" for name, _ in wanted.carried),
    ]
    return "\n".join([*lines, ""])
