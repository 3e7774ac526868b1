"""Download, convert, verify and find data sets: over HTTPS, or from this machine, with limits on size and time."""

from __future__ import annotations

import gzip
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from http.client import HTTPException, HTTPResponse, IncompleteRead, responses
from pathlib import Path
from typing import IO, TYPE_CHECKING, NoReturn
from urllib.error import HTTPError
from urllib.parse import quote, urlsplit
from urllib.request import HTTPRedirectHandler, ProxyHandler, Request, build_opener
from zlib import error as ZlibError

from ...errors import DownloadError, OptionError, RecordingError
from ...registry import Registry
from ...robot.locate import robots_folder
from ...version import __version__
from .sets import SETS, DataSet, Product

if TYPE_CHECKING:
    from ...types import Progress

VARIABLE = "SIGNID_DATA"  # folder of downloaded recordings; by default data
LOCAL = ("localhost", "127.0.0.1", "::1")
CHUNK = 2**16  # [bytes] read at once
GONE = (404, 410)  # HTTP status codes of missing files


@dataclass(frozen=True)
class DownloadLimits:
    """Limits of the download of a file."""

    size: int = 2**25  # [bytes]
    silence: float = 30.0  # maximum time without data [s]
    total: float = 600.0  # maximum duration [s]


LIMITS = DownloadLimits()


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


def fetch(
    wanted: DataSet, source: str | None = None, limits: DownloadLimits = LIMITS, progress: Progress | None = None
) -> dict[str, bytes]:
    """Download the files of a data set and return their contents by name, without writing them.

    `source` is the folder or address of a copy of the repository at the same commit; by default GitHub. The limits are
    those of each file.
    """
    base = wanted.base if source is None else check_source(source)

    def report(done: int, share: float) -> None:
        if progress is not None:
            progress(f"downloading {wanted.name}", (done + share) / len(wanted.sources))

    raw = {path: _obtain(base, path, limits, partial(report, k)) for k, path in enumerate(wanted.sources)}
    made = {product.name: _make(product, raw, wanted, base) for product in wanted.products}
    carried = {name: (robots_folder() / path).read_bytes() for name, path in wanted.carried}
    return {**made, **carried, f"source_{wanted.name}.txt": _note(wanted, base).encode()}


def check_source(source: str) -> str:
    """Validate the folder or address of a copy of a repository and remove trailing slashes.

    Raises:
        OptionError: there is no such folder, and the address is neither https nor of this machine.
    """
    folder = os.path.expanduser(source)
    if source and os.path.isdir(folder):
        return folder.rstrip("/") or "/"
    if not is_allowed(source, local=True) or urlsplit(source).query or urlsplit(source).fragment:
        advice = "give https://HOST/PATH, http://localhost:PORT for a server on this machine, or a folder"
        raise OptionError(f"--source {source!r} is not a valid address for downloads, and no folder; {advice}")
    return source.rstrip("/")


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


def is_allowed(address: str, local: bool) -> bool:
    """Whether an address is HTTPS or, with `local`, of this machine."""
    try:
        parts = urlsplit(address)
        host, _ = parts.hostname, parts.port
    except ValueError:
        return False
    return bool(host) and (parts.scheme == "https" or (parts.scheme == "http" and local and host in LOCAL))


def _obtain(base: str, path: str, limits: DownloadLimits, progress: Callable[[float], None]) -> bytes:
    """Read a file of the source from a folder, or download it."""
    if not os.path.isdir(base):
        return _download(f"{base}/{quote(path)}", limits, progress)
    file = Path(base, path)
    try:
        size = file.stat().st_size if file.is_file() else None
        content = file.read_bytes() if size is not None and size <= limits.size else b""
    except OSError as error:
        _fail(str(file), _reason(error, limits))
    if size is None:
        _fail(str(file), "there is no such file", again="")
    if size > limits.size:
        _fail(str(file), f"it has more than the limit of {limits.size / 1e6:g} MB", again="")
    progress(1.0)
    return content


def _download(address: str, limits: DownloadLimits, progress: Callable[[float], None]) -> bytes:
    """Download a file; `progress` gets the completed share [1], 0 if the server does not state the size."""
    request = Request(address, headers={"User-Agent": f"signid/{__version__}"})
    try:
        opener = build_opener(_Redirect, *([ProxyHandler({})] if _is_local(address) else []))
        with opener.open(request, timeout=limits.silence) as response:
            return _read(response, address, limits, progress)
    except DownloadError:
        raise
    except HTTPError as error:
        with error:
            again = {"again": ""} if error.code in GONE else {}
            _fail(address, f"the server answers {error.code} ({responses.get(error.code, 'unknown')})", **again)
    except (HTTPException, OSError, ValueError) as error:  # ValueError: invalid address or length
        _fail(address, _reason(getattr(error, "reason", error), limits))


def _read(response: HTTPResponse, address: str, limits: DownloadLimits, progress: Callable[[float], None]) -> bytes:
    length, most = response.headers.get("Content-Length", ""), f"{limits.size / 1e6:g} MB"
    expected = int(length) if length.isdecimal() else None
    end, content = time.monotonic() + limits.total, bytearray()
    if expected is not None and expected > limits.size:
        _fail(address, f"it has {expected / 1e6:.0f} MB, more than the limit of {most}", again="")
    while chunk := response.read1(CHUNK):
        content += chunk
        if len(content) > limits.size:
            _fail(address, f"it has more than the limit of {most}", again="")
        if time.monotonic() > end:
            _fail(address, f"it takes more than {limits.total:g} s")
        progress(len(content) / expected if expected else 0.0)
    if expected is not None and len(content) != expected:
        _fail(address, f"it ended after {len(content)} of {expected} bytes")
    return bytes(content)


class _Redirect(HTTPRedirectHandler):
    """Follow redirects to HTTPS addresses only, and from this machine to this machine."""

    def redirect_request(
        self, req: Request, fp: IO[bytes], code: int, msg: str, headers: object, newurl: str
    ) -> Request | None:
        if not is_allowed(newurl, _is_local(req.full_url)):
            _fail(req.full_url, f"it redirects to {newurl!r}, which is not encrypted", again="")
        return super().redirect_request(req, fp, code, msg, headers, newurl)  # type: ignore[arg-type]


def _is_local(address: str) -> bool:
    return urlsplit(address).hostname in LOCAL


def _reason(error: object, limits: DownloadLimits) -> str:
    if isinstance(error, TimeoutError):
        return f"no data for {limits.silence:g} s"
    if isinstance(error, IncompleteRead):
        return "it ended too early"
    return str(getattr(error, "strerror", None) or error).strip() or type(error).__name__


def _fail(address: str, reason: str, again: str = "try again, or ") -> NoReturn:
    raise DownloadError(f"cannot download {address}: {reason}; {again}name a copy of the repository by --source URL")
