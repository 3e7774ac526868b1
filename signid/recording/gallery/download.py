"""Download of a file over HTTPS, or from this machine, with limits on size and time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from http.client import HTTPException, HTTPResponse, IncompleteRead, responses
from typing import IO, NoReturn
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import HTTPRedirectHandler, OpenerDirector, ProxyHandler, Request, build_opener

from ...errors import DownloadError
from ...version import __version__

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


def is_allowed(address: str, local: bool) -> bool:
    """Whether an address is HTTPS or, with `local`, of this machine."""
    try:
        parts = urlsplit(address)
        host, _ = parts.hostname, parts.port
    except ValueError:
        return False
    return bool(host) and (parts.scheme == "https" or (parts.scheme == "http" and local and host in LOCAL))


def download(address: str, limits: DownloadLimits, progress: Callable[[float], None]) -> bytes:
    """Download a file.

    Args:
        address: https address, or http address of this machine.
        limits: limits on size and time.
        progress: function of the completed share [1]; 0 if the server does not state the size.

    Raises:
        DownloadError: failed download.
    """
    request = Request(address, headers={"User-Agent": f"signid/{__version__}"})
    try:
        with _opener(address).open(request, timeout=limits.silence) as response:
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


def _opener(address: str) -> OpenerDirector:
    return build_opener(_Redirect, *([ProxyHandler({})] if _is_local(address) else []))


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
