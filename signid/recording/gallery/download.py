"""Find data sets, or download them by pooch, convert and verify them: over HTTPS, or from this machine."""

from __future__ import annotations

import gzip
import os
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from http.client import IncompleteRead, responses
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit
from zlib import error as ZlibError

from ...errors import DownloadError, OptionError, RecordingError
from ...registry import Registry
from ...robot.locate import robots_folder
from ...version import __version__
from . import convert

if TYPE_CHECKING:
    from ...types import Progress

VARIABLE = "SIGNID_DATA"  # folder of downloaded recordings; by default data
LOCAL = ("localhost", "127.0.0.1", "::1")
GONE = (404, 410)  # HTTP status codes of missing files
SILENCE = 30.0  # limit of the time without data [s]


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
    carried, products = tuple(entry.pop("carried", {}).items()), []
    for file in entry.pop("files"):
        make = partial(getattr(convert, file["make"]), **file.get("options", {}))
        products.append(Product(file["name"], tuple(file["sources"]), make, file["sha256"]))
    return DataSet(name=name, products=tuple(products), carried=carried, **entry)


_LISTED = tomllib.loads(Path(__file__).with_name("sets.toml").read_text(encoding="utf-8"))
SETS = {name: _data_set(name, entry) for name, entry in _LISTED.items()}


class _Gallery(Registry[DataSet]):
    """Data sets of signid, which are no modules, and of other packages."""

    def __getitem__(self, name: str) -> DataSet:
        return SETS[name] if name in SETS else super().__getitem__(name)


DATA = _Gallery("data", __package__, " ".join(SETS))


def data_folder() -> Path:
    """Folder of the data sets: SIGNID_DATA, or `data` in the working directory."""
    return Path(os.path.expanduser(os.environ.get(VARIABLE) or "data"))


def recordings(name: str) -> Path:
    """Folder of the recordings of a data set.

    Raises:
        OptionError: unknown data set.
        RecordingError: missing or incomplete data set.
    """
    wanted = DATA[name]
    folder = data_folder() / wanted.folder
    lacking = [product.name for product in wanted.products if not (folder / product.name).is_file()]
    if lacking:
        where = f"{folder} lacks {lacking[0]}" if folder.is_dir() else f"there is no folder {folder}"
        setting = f"{VARIABLE} is {data_folder()}" if os.environ.get(VARIABLE) else f"{VARIABLE} is not set"
        raise RecordingError(f"the recordings of {name} are missing: {setting}, and {where}; run signid data {name}")
    return folder


def is_complete(wanted: DataSet, folder: Path) -> bool:
    """Whether a folder holds all files of a data set with the expected content."""
    return all(_has_digest(folder / product.name, product.sha256) for product in wanted.products)


def _has_digest(path: Path, digest: str) -> bool:
    try:
        content = path.read_bytes()
        text = gzip.decompress(content) if path.suffix == ".gz" else content
    except (OSError, EOFError, ZlibError):
        return False
    return sha256(text).hexdigest() == digest


def check_source(source: str) -> str:
    """Validate the folder or address of a copy of a repository and remove trailing slashes.

    Raises:
        OptionError: there is no such folder, and the address is neither https nor of this machine.
    """
    if source and os.path.isdir(folder := os.path.expanduser(source)):
        return folder.rstrip("/") or "/"
    try:
        parts = urlsplit(source)
        local, _ = parts.hostname in LOCAL, parts.port  # an invalid port is a ValueError
        allowed = parts.hostname and (parts.scheme == "https" or (parts.scheme == "http" and local))
    except ValueError:
        allowed = False
    if not allowed or parts.query or parts.fragment:
        advice = "give https://HOST/PATH, http://localhost:PORT for a server on this machine, or a folder"
        raise OptionError(f"--source {source!r} is not a valid address for downloads, and no folder; {advice}")
    return source.rstrip("/")


def fetch(wanted: DataSet, source: str | None = None, progress: Progress | None = None) -> dict[str, bytes]:
    """Download the files of a data set and return their contents by name, without writing them.

    `source` is the folder or address of a copy of the repository at the same commit; by default GitHub.

    Raises:
        DownloadError: a file cannot be downloaded or read, or has another content than expected.
    """
    base = wanted.base if source is None else check_source(source)
    raw: dict[str, bytes] = {}
    for path in wanted.sources:
        if progress is not None:
            progress(f"downloading {wanted.name}", len(raw) / len(wanted.sources))
        raw[path] = _obtain(f"{base}/{path}")
    made = {product.name: _make(product, raw, wanted, base) for product in wanted.products}
    carried = {name: (robots_folder() / path).read_bytes() for name, path in wanted.carried}
    return {**made, **carried, f"source_{wanted.name}.txt": _note(wanted, base).encode()}


def _make(product: Product, raw: Mapping[str, bytes], wanted: DataSet, base: str) -> bytes:
    advice = f"try again, or name a copy of the repository at commit {wanted.commit[:12]} by --source URL"
    after = f"nothing was written; {advice}"
    try:
        text = product.make(*(raw[path] for path in product.sources)).encode()
    except Exception as error:  # readers of unexpected files raise many types
        raise DownloadError(f"{product.name} from {base} cannot be read ({error}); {after}") from error
    digest = sha256(text).hexdigest()
    if digest != product.sha256:
        fact = f"has another content (sha256 {digest[:12]}... instead of {product.sha256[:12]}...)"
        raise DownloadError(f"{product.name} from {base} {fact}; {after}")
    return gzip.compress(text, mtime=0) if product.name.endswith(".gz") else text


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


def _obtain(address: str) -> bytes:
    """Read a file of a folder, or download it."""
    try:
        return _download(address) if urlsplit(address).scheme else Path(address).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: another attempt would fail as well
        status = getattr(getattr(error, "response", None), "status_code", None)
        reason = f"the server answers {status} ({responses.get(status, 'unknown')})" if status else _reason(error)
        again = "" if isinstance(error, ValueError) or status in GONE else "try again, or "
        advice = f"{again}name a copy of the repository by --source URL"
        raise DownloadError(f"cannot download {address}: {reason}; {advice}") from error


def _download(address: str) -> bytes:
    """Download a file to a temporary folder and return its content."""
    from pooch import HTTPDownloader, get_logger, retrieve

    local = urlsplit(address).hostname in LOCAL
    settings: dict[str, Any] = {"timeout": SILENCE, "headers": {"User-Agent": f"signid/{__version__}"}}
    settings["proxies"] = {"http": "", "https": ""} if local else None
    get_logger().setLevel("WARNING")
    with TemporaryDirectory() as place:
        return Path(retrieve(address, None, "source", place, downloader=HTTPDownloader(**settings))).read_bytes()


def _reason(error: BaseException) -> str:
    """Cause of an error of a connection, which is the first in a chain of errors."""
    while error.__context__ is not None:
        error = error.__context__
    if isinstance(error, TimeoutError):
        return f"no data for {SILENCE:g} s"
    if isinstance(error, IncompleteRead):
        return "it ended too early"
    return str(getattr(error, "strerror", None) or error).strip() or type(error).__name__
