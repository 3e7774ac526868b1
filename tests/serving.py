"""A local server with good or bad answers, and a small data set that tests can damage."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread
from types import SimpleNamespace
from urllib.parse import unquote

import pytest

from signid.recording.gallery import DATA, DataSet, Product

Answer = bytes | Callable[[BaseHTTPRequestHandler], None]
TEXT = b"t,q_1,tau_1\n0,0.5,1.5\n0.1,0.25,2\n"


@dataclass
class Server:
    """Address of the server and the requests it received."""

    address: str
    asked: list[str] = field(default_factory=list)
    over: Event = field(default_factory=Event)  # set when the test is


@contextmanager
def serve(answers: Mapping[str, Answer]) -> Iterator[Server]:
    """Answers by path: the bytes to send, or a function that answers."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = unquote(self.path).lstrip("/")
            known.asked.append(path)
            answer = answers.get(path, answers.get("*"))
            if answer is None:
                self.send_error(404)
            elif callable(answer):
                answer(self)
            else:
                send(self, answer)

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        known = Server(f"http://127.0.0.1:{server.server_port}")
        Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        try:
            yield known
        finally:
            known.over.set()
            server.shutdown()


def send(to: BaseHTTPRequestHandler, content: bytes, length: int | None = None, code: int = 200, **head: str) -> None:
    """An answer; its header may state another length than that of its body."""
    to.send_response(code)
    to.send_header("Content-Length", str(len(content) if length is None else length))
    for name, value in head.items():
        to.send_header(name, value)
    to.end_headers()
    to.wfile.write(content)


def toy(make: Callable[..., str] = bytes.decode, digest: str = sha256(TEXT).hexdigest()) -> DataSet:
    """One recording, stored unchanged at the source."""
    return DataSet(
        name="toy",
        title="a toy",
        folder="toy_there",
        seconds=0.1,
        repository="someone/something",
        commit="0" * 40,
        licence="MIT",
        cite="nobody",
        megabytes=0.1,
        products=(Product("toy.csv.gz", ("logs/a toy.csv".replace(" ", "_"),), make, digest),),
        example="signid check toy {folder}/toy.csv.gz",
    )


def register(wanted: DataSet, monkeypatch: pytest.MonkeyPatch) -> None:
    """Register a data set for the command line."""
    monkeypatch.setitem(DATA.modules, wanted.name, wanted.name)
    monkeypatch.setitem(sys.modules, f"signid.recording.gallery.{wanted.name}", SimpleNamespace(PLUGIN=wanted))  # type: ignore[arg-type]
