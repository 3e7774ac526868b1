"""A page in a real browser without a screen or a network, driven over Chromium's DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import os
import shutil
import signal
import subprocess
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tornado.websocket import WebSocketClientConnection, websocket_connect

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars "
    "--no-first-run --disable-background-networking --disable-component-update --remote-debugging-port=0"
).split()
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
PATIENCE = 60.0  # [s]
Picture = Any  # (height, width, 3) of whole numbers up to 255


def changed(area: tuple[slice, slice], before: Picture, after: Picture) -> int:
    """Number of pixels of an area that differ."""
    return int((np.abs(before[area] - after[area]).max(axis=2) > 12).sum())


class Chromium:
    """One window. Every request and every error of the page is kept."""

    def __init__(self, folder: Path, width: int = 1000, height: int = 700) -> None:
        program = next((found for name in PROGRAMS if (found := shutil.which(name))), None)
        if program is None:
            pytest.skip("no Chromium is installed: pages are tested in a real browser")
        arguments = [program, *FLAGS, OFFLINE, f"--user-data-dir={folder}", f"--window-size={width},{height}"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen([*arguments, "about:blank"], start_new_session=True, **quiet)  # type: ignore[call-overload]
        self.loop, self.number = asyncio.new_event_loop(), 0
        self.requests, self.errors = list[str](), list[str]()
        try:
            self.socket = self.loop.run_until_complete(self._connect(folder / "DevToolsActivePort"))
            for domain in ("Page", "Runtime", "Network", "Log"):
                self.send(f"{domain}.enable")
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            self.send("Emulation.setDeviceMetricsOverride", **size)
        except BaseException:
            self.close()
            raise

    async def _connect(self, port_file: Path) -> WebSocketClientConnection:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if port_file.is_file() and (lines := port_file.read_text().splitlines()):
                with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json", timeout=PATIENCE) as answer:
                    pages = [page for page in json.load(answer) if page["type"] == "page"]
                if pages:
                    return await websocket_connect(pages[0]["webSocketDebuggerUrl"], max_message_size=2**28)
            await asyncio.sleep(0.05)
        raise TimeoutError("Chromium did not start")

    def close(self) -> None:
        """End the browser and all that it started."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.loop.close()

    def send(self, method: str, **parameters: Any) -> Any:
        """The answer to a command of the protocol."""
        return self.loop.run_until_complete(asyncio.wait_for(self._send(method, parameters), PATIENCE))

    async def _send(self, method: str, parameters: Any) -> Any:
        self.number += 1
        await self.socket.write_message(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            message = json.loads(await self.socket.read_message())  # type: ignore[arg-type]
            self._note(message.get("method"), message.get("params", {}))
            if message.get("id") == self.number:
                assert "error" not in message, message["error"]
                return message["result"]

    def _note(self, event: str | None, params: Any) -> None:
        if event == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"][:200])
        elif event == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(params["exceptionDetails"])[:2000])
        elif event == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"])

    def open(self, url: str, ready: str = "true") -> None:
        """Load a page and wait until an expression is true."""
        self.requests.clear(), self.errors.clear()
        self.send("Page.navigate", url="about:blank")
        self.send("Page.navigate", url=url)
        self.until(f"document.readyState === 'complete' && !!({ready})")

    def until(self, expression: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.value(expression):
            assert time.monotonic() < end and not self.errors, (expression, self.errors)
            time.sleep(0.05)

    def value(self, expression: str) -> Any:
        """Value of an expression, as JSON."""
        result = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def click(self, selector: str, across: float = 0.5) -> None:
        """Press the mouse on an element at a share of its width."""
        box = self.value(
            f"(r => [r.x, r.y, r.width, r.height])(document.querySelector({selector!r}).getBoundingClientRect())"
        )
        place = {"x": box[0] + across * box[2], "y": box[1] + box[3] / 2, "button": "left", "clickCount": 1}
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, **place)

    def picture(self) -> Picture:
        """Screenshot of the page."""
        self.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))")
        data = self.send("Page.captureScreenshot", format="png")["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)
