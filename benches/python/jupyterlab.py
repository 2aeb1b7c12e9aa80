"""The widget of a painting in a real JupyterLab, driven in Chromium, with a picture to look at.

``python benches/python/jupyterlab.py FOLDER`` (in an environment with jupyterlab) starts a
JupyterLab of its own, runs a notebook with ``painting.view()``, moves the lamp by pointer and key,
reads what Python knows of it and writes ``light.png`` and ``dark.png``. Every line it prints is
measured; it ends with an error where the notebook does not show the painting.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import cv2

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import chromium

PATIENCE = 90.0
"""Seconds until the server answers."""
CELLS = [
    "import impasto\npainting = impasto.simulate.painting(size=(300, 400), seed=3)",
    "widget = painting.view(title='Landscape, simulated', pitch_mm=0.25)\nwidget",
    "widget.state",
]
BOX = "[...document.querySelectorAll('.jp-OutputArea-output div')].find(one => one.viewer)"
TEXT = "jupyterapp.shell.currentWidget.content.widgets"


def notebook(folder: Path) -> Path:
    """Cells that no one has run."""
    cells = [
        {"cell_type": "code", "id": f"cell{number}", "source": source, "metadata": {},
         "outputs": [], "execution_count": None}
        for number, source in enumerate(CELLS)
    ]  # fmt: skip
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    path = folder / "painting.ipynb"
    content = {
        "cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5
    }  # fmt: skip
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@contextlib.contextmanager
def server(folder: Path, port: int) -> Iterator[str]:
    """The address of a JupyterLab of this folder, for this machine alone."""
    token = secrets.token_hex(16)
    words = [
        "lab", "--no-browser", "--allow-root", "--ip=127.0.0.1", f"--port={port}",
        "--ServerApp.port_retries=0", f"--IdentityProvider.token={token}",
        f"--ServerApp.root_dir={folder}", "--LabApp.expose_app_in_browser=True",
    ]  # fmt: skip
    # No question about news, which would lie over the notebook.
    settings = folder / "config" / "lab" / "user-settings" / "@jupyterlab" / "apputils-extension"
    settings.mkdir(parents=True, exist_ok=True)
    (settings / "notification.jupyterlab-settings").write_text('{"fetchNews": "false"}')
    own = {"JUPYTER_CONFIG_DIR": str(folder / "config"), "JUPYTER_DATA_DIR": str(folder / "data")}
    with (folder / "server.log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "jupyter", *words], env=os.environ | own, stdout=log, stderr=log
        )
        try:
            end = time.monotonic() + PATIENCE
            while True:
                with contextlib.suppress(OSError):
                    address = f"http://127.0.0.1:{port}/api/status?token={token}"
                    urllib.request.urlopen(address, timeout=2).close()
                    break
                if process.poll() is not None or time.monotonic() > end:
                    raise RuntimeError(f"no JupyterLab: see {folder / 'server.log'}")
                time.sleep(0.2)
            yield f"http://127.0.0.1:{port}/lab/tree/painting.ipynb?reset&token={token}"
        finally:
            process.terminate()
            process.wait(20)


def run(folder: Path) -> None:
    """The notebook from opening to the last key."""
    path = notebook(folder)
    with (
        server(folder, 8899) as address,
        chromium.Chromium(folder / "profile", size=(1280, 900)) as browser,
    ):
        # Lab says when its notebook is there; Chromium.open waits for a word of the viewer's page.
        ready = "window.jupyterapp?.shell.currentWidget?.sessionContext?.session?.kernel?.id"
        browser.open(address, ready=f"!!({ready})")
        started = time.monotonic()
        browser.value("jupyterapp.commands.execute('notebook:run-all-cells').then(() => 0)")
        browser.until(f"{BOX}?.hasAttribute('data-ready')")
        print(f"from running all cells to the picture: {time.monotonic() - started:.1f} s")
        canvas = f"{BOX}.viewer.canvas"
        size = browser.value(f"[{canvas}.width, {canvas}.height]")
        print(f"canvas: {size[0]} x {size[1]} pixels")
        place = browser.value(
            f"(() => {{ const b = {canvas}.getBoundingClientRect();"
            "return [b.x + b.width / 2, b.y + b.height / 2, b.height]; })()"
        )
        x, y, height = place
        before = browser.value(f"{BOX}.viewer.host.read()")
        browser.drag((x, y), (x + 0.2 * height, y - 0.3 * height))
        kinds = browser.value(f"{TEXT}.map(cell => cell.model.type).join()")
        browser.key("m")
        browser.until(f"{BOX}.viewer.pointer.tool === 'move'")
        after = browser.value(f"{TEXT}.map(cell => cell.model.type).join()")
        print(f"cells before and after the key M: {kinds}; {after}")
        assert kinds == after, "a key of the viewer is a command of the notebook"
        # The page tells Python once the hand rests.
        wanted = browser.until(
            f"(text => text !== {json.dumps(before)} && text)({BOX}.viewer.host.read())"
        )
        browser.value("jupyterapp.shell.currentWidget.content.activeCellIndex = 2")
        browser.value("jupyterapp.commands.execute('notebook:run-cell').then(() => 0)")
        printed = f"{TEXT}[2].model.outputs.get(0)?.data['text/plain']"
        browser.until(f"({printed})?.includes('light=')")
        print(f"the page says {wanted}, Python {browser.value(printed)}")
        assert f"'{wanted}'" == browser.value(printed), "Python has another light"
        for name, theme in (("light", "JupyterLab Light"), ("dark", "JupyterLab Dark")):
            change = f"'apputils:change-theme', {{ theme: '{theme}' }}"
            browser.value(f"jupyterapp.commands.execute({change}).then(() => 0)")
            wanted = str(name == "light").lower()
            browser.until(f"document.body.dataset.jpThemeLight === '{wanted}'")
            time.sleep(1.0)  # the style sheet of the theme arrives after its name
            browser.value(f"{BOX}.scrollIntoView({{ block: 'center' }})")
            browser.screenshot(folder / f"{name}.png")
            left, top, wide, high = browser.value(
                f"(() => {{ const b = {canvas}.getBoundingClientRect();"
                "return [b.x, b.y, b.width, b.height].map(Math.round); })()"
            )
            picture = cv2.imread(str(folder / f"{name}.png"))
            spread = picture[top : top + high, left : left + wide].std()
            print(f"{name}: codes of the canvas have a standard deviation of {spread:.0f}")
            assert spread > 20, "the painting is not seen"
        print(f"pictures: {folder / 'light.png'}, {folder / 'dark.png'}; notebook: {path}")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("give a folder to write")
    target = Path(sys.argv[1]).resolve()
    target.mkdir(parents=True, exist_ok=True)
    run(target)
