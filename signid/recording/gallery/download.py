"""One file from the network: encrypted or from this machine, not too large, not too slow, whole."""

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
PIECE = 2**16  # bytes
GONE = (404, 410)


@dataclass(frozen=True)
class Patience:
    """What a file may ask of a user."""

    size: int = 2**25  # bytes
    silence: float = 30.0  # without a byte [s]
    total: float = 600.0  # [s]


USUAL = Patience()


def is_allowed(address: str, local: bool) -> bool:
    """Whether an address is encrypted, or is of this machine where that was asked for."""
    try:
        parts = urlsplit(address)
        host, _ = parts.hostname, parts.port
    except ValueError:
        return False
    return bool(host) and (parts.scheme == "https" or (parts.scheme == "http" and local and host in LOCAL))


def download(address: str, patience: Patience, progress: Callable[[float], None]) -> bytes:
    """The file at an address.

    Args:
        address: https, or http of this machine.
        patience: what is too large or too slow.
        progress: told the share that has come, where the server says how much there is.

    Raises:
        DownloadError: it cannot be had; the sentence says why.
    """
    request = Request(address, headers={"User-Agent": f"signid/{__version__}"})
    try:
        with _opener(address).open(request, timeout=patience.silence) as response:
            return _read(response, address, patience, progress)
    except DownloadError:
        raise
    except HTTPError as error:
        with error:
            again = {"again": ""} if error.code in GONE else {}
            _refuse(address, f"the server answers {error.code} ({responses.get(error.code, 'unknown')})", **again)
    except (HTTPException, OSError, ValueError) as error:  # the last of an address or a length that is none
        _refuse(address, _reason(getattr(error, "reason", error), patience))


def _read(response: HTTPResponse, address: str, patience: Patience, progress: Callable[[float], None]) -> bytes:
    told, most = response.headers.get("Content-Length", ""), f"{patience.size / 1e6:g} MB"
    expected = int(told) if told.isdecimal() else None
    end, content = time.monotonic() + patience.total, bytearray()
    if expected is not None and expected > patience.size:
        _refuse(address, f"it has {expected / 1e6:.0f} MB, where {most} are the most", again="")
    while piece := response.read1(PIECE):
        content += piece
        if len(content) > patience.size:
            _refuse(address, f"it has more than {most}", again="")
        if time.monotonic() > end:
            _refuse(address, f"it takes more than {patience.total:g} s")
        progress(len(content) / expected if expected else 0.0)
    if expected is not None and len(content) != expected:
        _refuse(address, f"it broke off after {len(content)} of {expected} bytes")
    return bytes(content)


class _Redirect(HTTPRedirectHandler):
    """Follows to encrypted addresses; to this machine only from this machine."""

    def redirect_request(
        self, req: Request, fp: IO[bytes], code: int, msg: str, headers: object, newurl: str
    ) -> Request | None:
        if not is_allowed(newurl, _is_local(req.full_url)):
            _refuse(req.full_url, f"it leads on to {newurl!r}, which is not encrypted", again="")
        return super().redirect_request(req, fp, code, msg, headers, newurl)  # type: ignore[arg-type]


def _opener(address: str) -> OpenerDirector:
    return build_opener(_Redirect, *([ProxyHandler({})] if _is_local(address) else []))


def _is_local(address: str) -> bool:
    return urlsplit(address).hostname in LOCAL


def _reason(error: object, patience: Patience) -> str:
    if isinstance(error, TimeoutError):
        return f"nothing came for {patience.silence:g} s"
    if isinstance(error, IncompleteRead):
        return "it broke off in the middle"
    return str(getattr(error, "strerror", None) or error).strip() or type(error).__name__


def _refuse(address: str, why: str, again: str = "try again, or ") -> NoReturn:
    raise DownloadError(f"cannot download {address}: {why}; {again}name a copy of the repository by --source URL")
