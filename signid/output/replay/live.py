"""Local server of a replay: a Meshcat viewer that other programs can draw into."""

from __future__ import annotations

import asyncio
import contextlib
import io
import threading
from pathlib import Path
from typing import Any

from ...errors import OutputError
from ..report.layout import NO_CONNECTION

LOCAL_ADDRESS = "127.0.0.1"  # no other machine can connect
LOCAL_NAMES = r"(localhost|127\.0\.0\.1)"  # names of this machine; a foreign name of it in a request is refused
MAX_START_SECONDS = 20.0  # time limit for the start of the server [s]


class Live:
    """A Meshcat server in a separate thread.

    `url` is the address for a browser, `zmq_url` the address for `meshcat.Visualizer`.
    """

    def __init__(self, page: str) -> None:
        """Start to serve a page.

        Args:
            page: HTML text.

        Raises:
            OutputError: no port is free.
        """
        self.url = self.zmq_url = ""
        self._page = page.replace("<body>", '<body class="live">', 1)
        self._loop: Any = None
        self._started, self._failure = threading.Event(), ""
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        if not self._started.wait(MAX_START_SECONDS) or self._failure:
            raise OutputError(f"the replay cannot be served: {self._failure or 'no answer'}; write it with --html FILE")

    def wait(self) -> None:
        """Wait until the server is closed."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """Stop the server."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(MAX_START_SECONDS)

    def _serve(self) -> None:
        self._loop = asyncio.new_event_loop()
        asyncio.set_event_loop(self._loop)
        try:
            with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
                bridge = _bridge(self._page)
            self.url, self.zmq_url = f"http://{bridge.host}:{bridge.fileserver_port}/replay", bridge.zmq_url
        except Exception as error:  # sockets and their libraries raise many types
            self._failure = " ".join(str(error).split()) or type(error).__name__
            return
        finally:
            self._started.set()
        self._loop.run_forever()


def _bridge(page: str) -> Any:
    """Meshcat's server with an additional page."""
    import tornado.web
    from meshcat.servers.zmqserver import VIEWER_ROOT, StaticFileHandlerNoCache, WebSocketHandler, ZMQWebSocketBridge

    class Page(tornado.web.RequestHandler):
        def get(self) -> None:
            self.set_header("Content-Security-Policy", "frame-ancestors 'none'")
            self.write(page.replace(NO_CONNECTION, f"connect-src ws://{self.request.host}", 1))

    class Socket(WebSocketHandler):  # type: ignore[misc]
        def open(self) -> None:  # silent, unlike Meshcat's own
            self.bridge.websocket_pool.add(self)
            self.bridge.send_scene(self)

        def on_close(self) -> None:
            self.bridge.websocket_pool.discard(self)

    class Application(tornado.web.Application):
        def listen(self, *port: Any, **options: Any) -> Any:
            return super().listen(*port, **{**options, "address": LOCAL_ADDRESS})

    class Bridge(ZMQWebSocketBridge):  # type: ignore[misc]
        def make_app(self) -> Any:
            static: dict[str, Any] = {"path": str(Path(VIEWER_ROOT)), "default_filename": "index.html"}
            handlers: list[Any] = [
                (r"/replay", Page),
                (r"/static/(.*)", StaticFileHandlerNoCache, static),
                (r"/", Socket, {"bridge": self}),
            ]
            served = Application(log_function=lambda handler: None)
            served.add_handlers(LOCAL_NAMES, handlers)
            return served

    return Bridge()
