"""Download, convert and verify a data set."""

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
from .download import LIMITS, DownloadLimits, download, is_allowed

if TYPE_CHECKING:
    from ...types import Progress


def fetch(
    wanted: DataSet,
    source: str | None = None,
    limits: DownloadLimits = LIMITS,
    progress: Progress | None = None,
) -> dict[str, bytes]:
    """Download the files of a data set and return their contents by name, without writing them.

    Args:
        wanted: the data set.
        source: address of a copy of the repository at the same commit; by default GitHub.
        limits: limits of each download.
        progress: function of the current step and its completed share [1].

    Raises:
        OptionError: the source is neither https nor of this machine.
        DownloadError: failed download, or a converted file with a wrong digest.
    """
    base = wanted.base if source is None else check_source(source)
    raw = {
        path: download(f"{base}/{quote(path)}", limits, _share(progress, wanted, k))
        for k, path in enumerate(wanted.sources)
    }
    made = {product.name: _make(product, raw, wanted, base) for product in wanted.products}
    carried = {name: (robots_folder() / path).read_bytes() for name, path in wanted.carried}
    return {**made, **carried, f"source_{wanted.name}.txt": _note(wanted, base).encode()}


def _share(progress: Progress | None, wanted: DataSet, done: int) -> Callable[[float], None]:
    """Progress function of one file that reports the share of all files."""

    def report(share: float) -> None:
        if progress is not None:
            progress(f"downloading {wanted.name}", (done + share) / len(wanted.sources))

    return report


def check_source(source: str) -> str:
    """Validate the address of a copy of a repository and remove trailing slashes.

    Raises:
        OptionError: the address is neither https nor of this machine.
    """
    if not is_allowed(source, local=True) or urlsplit(source).query or urlsplit(source).fragment:
        advice = "give https://HOST/PATH, or http://localhost:PORT for a server on this machine"
        raise OptionError(f"--source {source!r} is not a valid address for downloads; {advice}")
    return source.rstrip("/")


def _make(product: Product, raw: Mapping[str, bytes], wanted: DataSet, base: str) -> bytes:
    try:
        text = product.make(*(raw[path] for path in product.sources)).encode()
    except Exception as error:  # readers of unexpected files raise many types
        raise DownloadError(_fault(product, wanted, base, f"cannot be read ({error})")) from error
    digest = sha256(text).hexdigest()
    if digest != product.sha256:
        fact = f"has another content (sha256 {digest[:12]}... instead of {product.sha256[:12]}...)"
        raise DownloadError(_fault(product, wanted, base, fact))
    return gzip.compress(text, mtime=0) if product.name.endswith(".gz") else text


def _fault(product: Product, wanted: DataSet, base: str, fact: str) -> str:
    advice = f"try again, or name a copy of the repository at commit {wanted.commit[:12]} by --source URL"
    return f"{product.name} from {base} {fact}; nothing was written; {advice}"


def _note(wanted: DataSet, base: str) -> str:
    lines = [
        f"{wanted.name}: {wanted.title}",
        f"repository: https://github.com/{wanted.repository}",
        f"commit: {wanted.commit}",
        f"downloaded from: {base}",
        f"licence: {wanted.licence}",
        f"please cite: {wanted.cite}",
        f"converted by signid {__version__} (sha256 of the text before compression):",
        *(f"  {product.sha256}  {product.name} <- {', '.join(product.sources)}" for product in wanted.products),
        *(f"  {name}: comes with signid" for name, _ in wanted.carried),
    ]
    return "\n".join([*lines, ""])
