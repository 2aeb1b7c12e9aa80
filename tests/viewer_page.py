"""The page of a painting in a browser, as tests of it use it."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

import chromium


def shown(browser: chromium.Chromium, changes: dict[str, Any], scale: int = 0) -> NDArray[Any]:
    """What the page makes of a state, ``(y, x, 4)`` codes."""
    data = browser.value(
        "(async () => { const { viewer } = window.impasto;"
        f"viewer.set({{ ...viewer.first, ...{json.dumps(changes)} }});"
        f"const {{ width, height, data }} = await viewer.picture({scale});"
        "let text = ''; for (const code of data) text += String.fromCharCode(code);"
        "return [height, width, btoa(text)]; })()"
    )
    height, width, text = data
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)


def on_canvas(browser: chromium.Chromium, changes: dict[str, Any]) -> NDArray[Any]:
    """What is on the canvas in a state, ``(y, x, 4)`` codes, row 0 at the top."""
    data = browser.value(
        "new Promise(done => requestAnimationFrame(() => { const { viewer } = window.impasto;"
        f"viewer.set({{ ...viewer.first, ...{json.dumps(changes)} }}); viewer.draw(0);"
        "const { gl, canvas } = viewer.renderer, { width, height } = canvas;"
        "const data = new Uint8Array(4 * width * height);"
        "gl.bindFramebuffer(gl.FRAMEBUFFER, null);"
        "gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, data);"
        "let text = ''; for (const code of data) text += String.fromCharCode(code);"
        "done([height, width, btoa(text)]); }))"
    )
    height, width, text = data
    codes = np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)
    return codes[::-1]
