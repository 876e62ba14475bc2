"""A headless Chromium for tests of pages, spoken to by its DevTools protocol over two pipes.

with Browser(tmp_path) as browser:
    page = browser.open(path)
    page.press("ArrowRight")
    assert page.value("document.title") == "mdkf"
    assert page.complaints == [] and page.requests == [path.as_uri()]
"""

import base64
import fcntl
import json
import os
import select
import shutil
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FOUND = next((found for name in NAMES if (found := shutil.which(name))), None)
needs_browser = pytest.mark.skipif(
    FOUND is None, reason=f"no browser on the PATH: one of {', '.join(NAMES)}"
)

OPTIONS = (
    *("--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--disable-gpu"),
    *("--disable-dev-shm-usage", "--disable-background-networking", "--disable-extensions"),
    *("--no-first-run", "--no-default-browser-check", "--disable-component-update"),
)
PATIENCE = 60.0
"""Longest wait for an answer [s]."""

KEYS = {" ": ("Space", 32), "ArrowLeft": ("ArrowLeft", 37), "ArrowRight": ("ArrowRight", 39)}
"""Keys by name: code, and number on Windows keyboards, which the protocol asks for."""


class Browser:
    """One Chromium process, with a profile of its own in a folder."""

    def __init__(self, folder: Path) -> None:
        if FOUND is None:
            raise RuntimeError("no browser on the PATH")
        theirs_in, self._to = os.pipe()
        self._from, theirs_out = os.pipe()
        # The browser reads from 3 and writes to 4: ours must be out of the way first.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (theirs_in, theirs_out)]
        log = str(folder / "chromium.log")
        self._process = os.posix_spawn(
            FOUND,
            [FOUND, *OPTIONS, f"--user-data-dir={folder / 'chromium'}", "about:blank"],
            {**os.environ, "HOME": str(folder)},
            file_actions=[
                (os.POSIX_SPAWN_OPEN, 2, log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600),
                (os.POSIX_SPAWN_DUP2, ends[0], 3),
                (os.POSIX_SPAWN_DUP2, ends[1], 4),
            ],
            setpgroup=0,
        )
        for end in (theirs_in, theirs_out, *ends):
            os.close(end)
        self._number = 0
        self._unread = b""
        self._pages: dict[str, Page] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *failure: object) -> None:
        os.killpg(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)
        os.close(self._to)
        os.close(self._from)

    def open(self, path: Path, width: int = 1400, height: int = 900) -> "Page":
        """A page of a file, loaded, in a window of this size [px]."""
        target = self.ask("Target.createTarget", {"url": "about:blank"})["targetId"]
        attached = {"targetId": target, "flatten": True}
        session = self.ask("Target.attachToTarget", attached)["sessionId"]
        page = self._pages[session] = Page(self, session)
        for domain in ("Page", "Runtime", "Network", "Log"):
            page.ask(f"{domain}.enable")
        page.ask("Page.setLifecycleEventsEnabled", {"enabled": True})
        page.resize(width, height)
        loading = page.ask("Page.navigate", {"url": path.as_uri()})["loaderId"]
        while loading not in page.loaded:
            self._hear()
        return page

    def ask(self, method: str, parameters: Mapping[str, Any] = {}, session: str = "") -> Any:
        """The answer to a command of the protocol. Raises `RuntimeError` if it is refused."""
        self._number += 1
        asked: dict[str, Any] = {"id": self._number, "method": method, "params": dict(parameters)}
        if session:
            asked["sessionId"] = session
        os.write(self._to, json.dumps(asked).encode() + b"\0")
        while (told := self._hear()).get("id") != self._number:
            pass
        if "error" in told:
            raise RuntimeError(f"{method}: {told['error']['message']}")
        return told["result"]

    def _hear(self) -> dict[str, Any]:
        """The next message; the page that it is about has heard it."""
        until = time.monotonic() + PATIENCE
        while b"\0" not in self._unread:
            if not select.select([self._from], [], [], max(until - time.monotonic(), 0))[0]:
                raise RuntimeError(f"the browser did not answer within {PATIENCE:g} s")
            received = os.read(self._from, 1 << 20)
            if not received:
                raise RuntimeError("the browser ended")
            self._unread += received
        message, self._unread = self._unread.split(b"\0", 1)
        told: dict[str, Any] = json.loads(message)
        page = self._pages.get(told.get("sessionId", ""))
        if page is not None and "method" in told:
            page.hear(told["method"], told["params"])
        return told


class Page:
    """A page in the browser. complaints: errors and warnings of its scripts and on its console.
    requests: the addresses that it has asked for, itself included. loaded: what has been loaded
    into it, by the browser's numbers."""

    def __init__(self, browser: Browser, session: str) -> None:
        self._browser = browser
        self._session = session
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.loaded: set[str] = set()

    def ask(self, method: str, parameters: Mapping[str, Any] = {}) -> Any:
        """The answer to a command of the protocol to this page."""
        return self._browser.ask(method, parameters, self._session)

    def hear(self, event: str, told: Mapping[str, Any]) -> None:
        """What the page does by itself."""
        if event == "Page.lifecycleEvent" and told["name"] == "load":
            self.loaded.add(told["loaderId"])
        elif event == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
        elif event == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.complaints.append(
                details.get("exception", details).get("description", "exception")
            )
        elif event == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.complaints.append(json.dumps(told["args"]))
        elif event == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.complaints.append(told["entry"]["text"])

    def value(self, expression: str) -> Any:
        """The value of a JavaScript expression, a promise's once it is kept.

        Raises `RuntimeError` if it throws.
        """
        asked = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        told = self.ask("Runtime.evaluate", asked)
        if "exceptionDetails" in told:
            raise RuntimeError(f"{expression}: {told['result'].get('description', 'exception')}")
        return told["result"].get("value")

    def wait(self, expression: str) -> None:
        """Until a JavaScript expression is true. Raises `RuntimeError` if it takes too long."""
        until = time.monotonic() + PATIENCE
        while not self.value(expression):
            if time.monotonic() > until:
                raise RuntimeError(f"not within {PATIENCE:g} s: {expression}")
            time.sleep(0.02)

    def press(self, key: str) -> None:
        """A key of the keyboard, down and up."""
        code, number = KEYS[key]
        told = {"key": key, "code": code, "windowsVirtualKeyCode": number}
        text = {"text": key} if len(key) == 1 else {}
        self.ask("Input.dispatchKeyEvent", {"type": "keyDown", **told, **text})
        self.ask("Input.dispatchKeyEvent", {"type": "keyUp", **told})

    def move(self, x: float, y: float) -> None:
        """The mouse, to a place in the window [px]."""
        self.ask("Input.dispatchMouseEvent", {"type": "mouseMoved", "x": x, "y": y})

    def click(self, x: float, y: float) -> None:
        """A click of the left button at a place in the window [px]."""
        self.move(x, y)
        for kind in ("mousePressed", "mouseReleased"):
            told = {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1}
            self.ask("Input.dispatchMouseEvent", told)

    def resize(self, width: int, height: int) -> None:
        """The window [px]."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.ask("Emulation.setDeviceMetricsOverride", size)

    def as_printed(self, printed: bool = True) -> None:
        """Shown with the styles of paper, or of the screen again."""
        self.ask("Emulation.setEmulatedMedia", {"media": "print" if printed else ""})

    def screenshot(self, path: Path, whole: bool = False) -> None:
        """A PNG of what is in the window, or of the whole page."""
        told = self.ask("Page.captureScreenshot", {"captureBeyondViewport": whole})
        path.write_bytes(base64.b64decode(told["data"]))

    def pdf(self, path: Path) -> None:
        """The page as it is printed."""
        told = self.ask("Page.printToPDF", {"printBackground": True})
        path.write_bytes(base64.b64decode(told["data"]))
