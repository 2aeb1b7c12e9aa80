"""The page and the widget break none of axe-core's rules, with every section open."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

import axe
import chromium
import impasto
from impasto.simulate import camera
from impasto.viewer import Contents, ViewServer, script
from loopback import serving
from test_viewer_samples import PLACE, photographed
from test_viewer_widget import MODEL, traits

OPEN = "document.querySelectorAll('details').forEach(one => { one.open = true; })"


@pytest.fixture(scope="module")
def page() -> Iterator[ViewServer]:
    """A page with all sections: spectra, photographs, another painting and samples."""
    stack = photographed()
    fitted = impasto.fit_sbrdf(stack, pooling="painting", check=False)
    contents = Contents(
        fitted, stack=stack, camera=camera("rgb"), against=fitted, against_title="Before",
        title="Icon", pitch_mm=1.0,
    )  # fmt: skip
    with serving(ViewServer(contents)) as server:
        yield server


def seen(browser: chromium.Chromium, dark: bool, size: tuple[int, int]) -> None:
    """The page in other colours, on another screen."""
    theme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    browser.call("Emulation.setEmulatedMedia", features=[theme])
    browser.call(
        "Emulation.setDeviceMetricsOverride",
        width=size[0], height=size[1], deviceScaleFactor=1, mobile=False,
    )  # fmt: skip


def test_the_page_breaks_no_rule(page: ViewServer, tmp_path: Path) -> None:
    """Light on a screen with a dialog, then dark on a telephone, in two more states."""
    chromium.needed()
    code = axe.source()
    row, column = PLACE
    with chromium.Chromium(tmp_path, size=(1300, 900)) as browser:
        browser.open(f"{page.url}#pixel={column},{row}&clipped=1&d=0.5")
        browser.until("document.querySelector('.taken .samples') !== null")
        browser.value(OPEN)
        browser.until("document.querySelector('.plan') !== null")
        browser.value(
            "window.impasto.viewer.notes = []; window.impasto.viewer.askNote([2, 3, 4, 5])"
        )
        assert axe.violations(browser, code) == []
        browser.value("document.querySelector('textarea').value = 'a loss'")
        browser.click("dialog .main")
        for dark, size, changes in (
            (True, (400, 850), {"environment": "gallery"}),
            (False, (2560, 1400), {"against": True, "compare": "difference", "tilt": 30}),
        ):
            seen(browser, dark, size)
            browser.value(
                f"window.impasto.viewer.set({{ ...window.impasto.viewer.first, pixel: [{column},"
                f" {row}], ...{json.dumps(changes)} }})"
            )
            assert axe.violations(browser, code) == [], changes


def test_the_widget_breaks_no_rule(tmp_path: Path) -> None:
    """In a notebook that is light, and in one that is dark."""
    chromium.needed()
    code = axe.source()
    stack = photographed()
    fitted = impasto.fit_sbrdf(stack, pooling="painting", check=False)
    widget = fitted.view(stack=stack, embed=True, title="Icon")
    document = (
        f"<!doctype html><html lang=en><title>mine</title><main></main><script>{MODEL}</script>"
    )
    (tmp_path / "index.html").write_text(document, encoding="utf-8")
    make = widget._contents.data("samples/7-21")
    assert make is not None
    samples = base64.b64encode(make()).decode()
    with chromium.Chromium(tmp_path / "profile", size=(900, 900)) as browser:
        browser.open((tmp_path / "index.html").as_uri())
        browser.value(f"window.code = {json.dumps(script('notebook'))}")
        browser.value(f"window.show({json.dumps(traits(widget))})")
        browser.until("box.hasAttribute('data-ready')")
        browser.value(f"box.viewer.inspect({PLACE[1]}, {PLACE[0]})")
        browser.until("model.sent.some(one => one.file === 'samples/7-21')")
        browser.value(f"answer('samples/7-21', '{samples}')")
        browser.until("box.shadowRoot.querySelector('.taken .samples') !== null")
        browser.value(OPEN.replace("document", "box.shadowRoot"))
        for light in ("true", "false"):
            browser.value(f"document.body.dataset.jpThemeLight = '{light}'")
            browser.value("new Promise(done => setTimeout(done, 300))")
            found = axe.violations(browser, code)
            # The page around it is the test's: a stand-in for a notebook.
            assert [one for one in found if "mine" not in str(one[2])] == [], light
