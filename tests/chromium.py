"""A browser without a window, driven by the Chrome DevTools Protocol through two pipes."""

from __future__ import annotations

import base64
import json
import os
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

PROGRAM = shutil.which("chromium")
PATIENCE = 60.0
"""Seconds for an answer: the browser starts on a busy machine."""

START = """
import os, sys
ends = [os.dup(os.dup(int(word))) for word in sys.argv[1:3]]
os.dup2(ends[0], 3)
os.dup2(ends[1], 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""The browser reads from descriptor 3 and writes to 4; a shell names only nine descriptors."""


def needed() -> None:
    """Skip a test where there is no browser; with ``IMPASTO_EXPECT_BROWSER=1`` it fails."""
    if PROGRAM is None:
        if os.environ.get("IMPASTO_EXPECT_BROWSER") == "1":
            pytest.fail("chromium is not installed (apt-get install chromium)")
        pytest.skip("chromium is not installed")


class Chromium:
    """One page of a browser with a profile of its own.

    Parameters
    ----------
    folder
        For the profile.
    dark
        Whether pages are asked for their dark colours.
    size
        Columns and rows of the page.
    """

    def __init__(self, folder: Path, *, dark: bool = False, size: tuple[int, int] = (1280, 800)):
        assert PROGRAM is not None
        into_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        words = [
            PROGRAM, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-dev-shm-usage", "--disable-background-networking",
            "--disable-component-update",
            "--remote-debugging-pipe", f"--user-data-dir={folder}", "about:blank",
        ]  # fmt: skip
        self._process = subprocess.Popen(
            [sys.executable, "-c", START, str(into_browser), str(from_browser), *words],
            pass_fds=(into_browser, from_browser),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(into_browser)
        os.close(from_browser)
        self._number, self._left = 0, b""
        self._fingers: tuple[tuple[float, float], ...] = ()
        self._session: str | None = None
        self._theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._size = size

    def __enter__(self) -> Chromium:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one message."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + PATIENCE
        while True:
            while b"\0" not in self._left:
                ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
                if not ready:
                    raise TimeoutError(f"{method}: no answer within {PATIENCE:g} s")
                if not (more := os.read(self._read, 1 << 16)):
                    raise EOFError(f"{method}: the browser has ended")
                self._left += more
            text, _, self._left = self._left.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return dict(answer["result"])

    @property
    def address(self) -> str:
        """That of the page that is open, without what stands behind #; empty before the first."""
        return "" if self._session is None else str(self.value("location.href.split('#')[0]"))

    def value(self, expression: str) -> Any:
        """What JavaScript makes of an expression, promises awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(json.dumps(answer["exceptionDetails"])[:2000])
        return answer["result"].get("value")

    def until(self, expression: str) -> Any:
        """Wait until an expression is true, and return it."""
        end = time.monotonic() + PATIENCE
        while not (found := self.value(expression)):
            if time.monotonic() > end:
                raise TimeoutError(f"not true within {PATIENCE:g} s: {expression}")
            time.sleep(0.02)
        return found

    def open(self, url: str, *, ready: str = "document.documentElement?.dataset.ready") -> None:
        """Load a page, until it says that it is ready."""
        # In a new tab: an older one may ask whether to leave what was not saved.
        self._session = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        self.call("Emulation.setEmulatedMedia", features=[self._theme])
        width, height = self._size
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        self.call("Page.navigate", url=url)
        # A page may write what it shows behind #, and take its token from behind ?.
        page = json.dumps(re.split(r"[?#]", url)[0])
        self.until(f"location.href.split(/[?#]/)[0] === {page} && {ready}")

    def key(self, key: str, *, shift: bool = False, ctrl: bool = False) -> None:
        """Press and release a key."""
        held = 8 * shift + 2 * ctrl
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=held)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the left button at a place of the page, move, and release it."""
        for kind, (x, y) in (("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)):
            self.call(
                "Input.dispatchMouseEvent",
                type=kind, x=x, y=y, button="left", buttons=int(kind != "mouseReleased"),
                clickCount=1,
            )  # fmt: skip

    def touch(self, *fingers: tuple[float, float]) -> None:
        """Fingers on the screen: as many are moved, more are put down, none lifts all."""
        before, self._fingers = self._fingers, fingers
        kind = "touchMove" if len(before) == len(fingers) else "touchStart"
        if not fingers:
            kind = "touchEnd"
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def write(self, text: str) -> None:
        """Text into what has the focus."""
        self.call("Input.insertText", text=text)

    def saved(self, folder: Path, save: Callable[[], None]) -> Path:
        """The file that something saves, once it is whole."""
        folder.mkdir()
        self.call(
            "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder.resolve())
        )
        save()
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            found = [one for one in folder.iterdir() if one.suffix != ".crdownload"]
            if found and len(found) == len(list(folder.iterdir())):
                return found[0]
            time.sleep(0.02)
        raise TimeoutError(f"nothing was saved within {PATIENCE:g} s")

    def choose_file(self, selector: str, path: Path) -> None:
        """Give a file to the field of a form, as its dialog does."""
        element = f"document.querySelector({json.dumps(selector)})"
        found = self.call("Runtime.evaluate", expression=element)["result"]["objectId"]
        self.call("DOM.setFileInputFiles", files=[str(path)], objectId=found)

    def click(self, selector: str) -> None:
        """Click on the middle of an element."""
        box = self.value(
            f"(() => {{ const b = document.querySelector({json.dumps(selector)})"
            ".getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        self.drag(tuple(box), tuple(box))

    def screenshot(self, path: Path) -> None:
        """Write what the page shows as PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))
