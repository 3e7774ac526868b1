"""The server of a live replay: for this machine alone, and for its own page."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import pytest

from signid.output.replay import Live
from signid.output.report.policy import content_policy

PAGE = f'<html><head><meta content="{content_policy(["a"])}"></head><body></body></html>'


@pytest.fixture(scope="module")
def live() -> Iterator[Live]:
    served = Live(PAGE)
    yield served
    served.close()


def test_the_page_connects_to_its_own_server_only(live: Live) -> None:
    for name in ("127.0.0.1", "localhost"):
        host = f"{name}:{urlsplit(live.url).port}"
        with urlopen(f"http://{host}/replay", timeout=60) as answer:
            text = answer.read().decode()
            assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
        assert f"connect-src ws://{host};" in text and '<body class="live">' in text


def test_other_addresses_of_the_machine_do_not_answer(live: Live) -> None:
    port = urlsplit(live.url).port
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", port), timeout=5):
        pass


@pytest.mark.parametrize("path", ["replay", "static/main.min.js", ""])
@pytest.mark.parametrize("host", ["example.com:7000", "localhost.example.com", "localhost;script-src *"])
def test_a_request_under_a_foreign_name_is_refused(live: Live, path: str, host: str) -> None:
    """A web page that resolves its own name to this machine cannot read the replay."""
    with pytest.raises(HTTPError, match="404|400"):
        urlopen(Request(live.url.replace("replay", path), headers={"Host": host}), timeout=60)
