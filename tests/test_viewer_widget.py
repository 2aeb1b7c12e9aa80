"""The painting in a notebook: the widget's script in a browser, with a stand-in for its model."""

from __future__ import annotations

import base64
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import chromium
import impasto
import processes
from impasto.surface import Surface
from impasto.viewer import script

MODEL = """
// What anywidget's documentation says of a model: get, set, save_changes, send, on and off.
class Model {
  constructor(values) { this.values = values; this.calls = {}; this.sent = []; this.saved = 0; }
  get(name) { return this.values[name]; }
  set(name, value) { this.values[name] = value; this.call(`change:${name}`); }
  save_changes() { this.saved++; }
  send(content) { this.sent.push(content); }
  on(name, call) { (this.calls[name] ??= new Set()).add(call); }
  off(name, call) { this.calls[name]?.delete(call); }
  call(name, ...values) { for (const one of this.calls[name] ?? []) one(...values); }
}
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
window.show = async values => {
  const files = Object.entries(values.files).map(([k, v]) => [k, new DataView(bytes(v).buffer)]);
  window.model = new Model({ ...values, files: Object.fromEntries(files) });
  window.answer = (name, text) => model.call(
    "msg:custom", { file: name }, [new DataView(bytes(text).buffer)]);
  // As anywidget loads a module that is given as text.
  const address = URL.createObjectURL(new Blob([window.code], { type: "text/javascript" }));
  const { default: widget } = await import(address);
  window.close_widget?.();
  document.body.replaceChildren(document.createElement("div"));
  window.close_widget = widget.render({ model, el: document.body.firstChild });
  window.box = document.body.firstChild.firstChild;
};
document.documentElement.dataset.ready = "true";
"""
"""The page around the widget."""


def surface() -> Surface:
    random = np.random.default_rng(2)
    normal = np.concatenate([random.normal(0.0, 0.2, (2, 20, 30)), np.ones((1, 20, 30))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.1, 0.8, (3, 20, 30))
    return Surface.torrance_sparrow(normal, diffuse, 2.0, 0.2, pitch_mm=0.5)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    chromium.needed()
    folder = tmp_path_factory.mktemp("page")
    page = f"<!doctype html><title>mine</title><body><script>{MODEL}</script>"
    (folder / "index.html").write_text(page, encoding="utf-8")
    profile = tmp_path_factory.mktemp("profile")
    with chromium.Chromium(profile, size=(900, 640)) as started:
        started.open((folder / "index.html").as_uri())
        started.value(f"window.code = {json.dumps(script('notebook'))}")
        yield started


def traits(widget: Any) -> dict[str, Any]:
    """What the front end of a notebook is given."""
    state = widget.get_state()
    files = {name: base64.b64encode(data).decode() for name, data in state["files"].items()}
    names = ("document", "state", "notes", "height_px")
    return {"files": files, **{name: state[name] for name in names}}


def shown(browser: chromium.Chromium, widget: Any) -> None:
    browser.value(f"window.show({json.dumps(traits(widget))})")


def codes(browser: chromium.Chromium) -> NDArray[Any]:
    height, width, text = browser.value(
        "(async () => { const { height, width, data } = await box.viewer.picture(0);"
        "return [height, width, btoa(String.fromCharCode(...data))]; })()"
    )
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)


def rendered(light: impasto.DistantLight) -> NDArray[np.uint8]:
    return impasto.render(surface(), impasto.Scene([light])).display


def test_tiles_come_by_messages(browser: chromium.Chromium) -> None:
    """And the picture is that of the renderer, within the one code of ``test_viewer.py``."""
    widget = surface().view(title="Icon")
    answers: list[tuple[Any, Any]] = []
    widget.send = lambda content, buffers=None: answers.append((content, buffers))
    shown(browser, widget)
    (asked,) = browser.value("model.sent")
    assert asked == {"file": "tiles/0/0-0"}
    widget._handle_custom_msg(asked, [])
    ((content, (data,)),) = answers
    assert content == asked
    browser.value(f"answer({json.dumps(content['file'])}, '{base64.b64encode(data).decode()}')")
    browser.until("box.hasAttribute('data-ready')")
    light = impasto.DistantLight((0, 0.5**0.5, 0.5**0.5))
    found = codes(browser)
    assert np.abs(found[..., :3].astype(int) - rendered(light)).max() <= 1
    assert rendered(light).std() > 5
    assert browser.value("model.sent.length") == 1, "a tile that is there is not asked for again"


def test_a_page_asks_for_nothing_but_its_files() -> None:
    widget = surface().view()
    answers: list[Any] = []
    widget.send = lambda content, buffers=None: answers.append((content, buffers))
    for name in ("../widget.py", "tiles/0/0-1", "tiles/9/0-0", "photographs/0", "index.html", 3):
        widget._handle_custom_msg({"file": name}, [])
        assert answers.pop()[0]["refused"] == "there is nothing of this name", name
    widget._handle_custom_msg("tiles/0/0-0", [])
    assert answers.pop()[0]["refused"] == "there is nothing of this name"


def test_a_saved_notebook_needs_no_python(browser: chromium.Chromium) -> None:
    shown(browser, surface().view(embed=True))
    browser.until("box.hasAttribute('data-ready')")
    assert browser.value("model.sent.length") == 0


def test_the_state_is_that_of_python(browser: chromium.Chromium) -> None:
    shown(browser, surface().view(embed=True))
    browser.until("box.hasAttribute('data-ready')")
    # From Python to the page.
    browser.value("model.set('state', 'light=200,20&layer=normals')")
    assert browser.value("box.viewer.state.azimuth") == 200
    assert browser.value("box.viewer.state.layer") == "normals"
    browser.value("model.set('state', 'light=30,40')")
    light = impasto.DistantLight.from_angles(np.radians(30), np.radians(40))
    found = codes(browser)[..., :3].astype(int)
    assert np.abs(found - rendered(light)).max() <= 1
    # And back, once the hand rests.
    before = browser.value("model.saved")
    browser.value("box.viewer.set({ azimuth: 120, elevation: 50 })")
    browser.until(f"model.saved > {before}")
    assert browser.value("model.get('state')") == "light=120,50"
    # Notes, too; and the address and the title of the notebook are its own.
    browser.value(
        "box.viewer.askNote([2, 3, 4, 5]); box.shadowRoot.querySelector('textarea').value = 'a';"
        "box.shadowRoot.querySelector('dialog .main').click()"
    )
    browser.until("model.get('notes').length === 1")
    (note,) = browser.value("model.get('notes')")
    assert note["target"]["selector"]["value"] == "xywh=pixel:2,3,4,5"
    assert browser.value("[document.title, location.hash]") == ["mine", ""]


def test_style_and_keys_stay_inside(browser: chromium.Chromium) -> None:
    shown(browser, surface().view(embed=True, height_px=300))
    browser.until("box.hasAttribute('data-ready')")
    assert browser.value("box.getBoundingClientRect().height") == 300
    assert browser.value("getComputedStyle(document.body).margin") == "8px", "the browser's own"
    # Notebooks have commands on single letters; a cell must not become text by M for move.
    browser.value(
        "window.heard = []; document.addEventListener('keydown', event => heard.push(event.key));"
        "box.viewer.canvas.focus()"
    )
    browser.key("m")
    browser.until("box.viewer.pointer.tool === 'move'")
    assert browser.value("heard") == []
    # Dark as the notebook, whatever the system is.
    for light, colour in (("false", "rgb(26, 27, 29)"), ("true", "rgb(251, 251, 250)")):
        browser.value(f"document.body.dataset.jpThemeLight = '{light}'")
        browser.value("new Promise(done => setTimeout(done, 0))")
        paper = "getComputedStyle(box.shadowRoot.querySelector('aside')).backgroundColor"
        assert browser.value(paper) == colour
    browser.value("close_widget()")
    assert browser.value("box.viewer.renderer.gl.isContextLost()")
    assert browser.value("Object.values(model.calls).every(calls => calls.size === 0)")


def test_an_output_that_was_hidden_is_drawn_again(browser: chromium.Chromium) -> None:
    """JupyterLab hides outputs while it changes its theme, and the light may change meanwhile."""
    shown(browser, surface().view(embed=True))
    browser.until("box.hasAttribute('data-ready')")
    frames = "new Promise(done => requestAnimationFrame(() => setTimeout(done, 50)))"
    browser.value("box.style.display = 'none'; box.viewer.set({ azimuth: 10, view: null })")
    browser.value(frames)
    browser.value(
        "const { draw } = box.viewer.renderer; window.drawn = 0;"
        "box.viewer.renderer.draw = function (names, options) {"
        "  drawn++; window.zoom = options.zoom; draw.call(this, names, options); };"
        "box.style.display = ''"
    )
    browser.until("drawn > 0")
    assert browser.value("zoom") > 1
    assert re.search(r"\d (mm|cm)", browser.value("box.viewer.scaleBar.textContent"))


def test_mistakes_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(impasto.ArgumentError, match="height_px: expected 240 to 4000, found 10"):
        surface().view(height_px=10)
    monkeypatch.setattr("impasto.viewer.widget.MOST_EMBEDDED", 1000)
    with pytest.raises(impasto.ArgumentError, match="embed: the tiles of this painting take"):
        surface().view(embed=True)
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(impasto.MissingExtraError, match=r"pip install 'impasto\[viewer\]'"):
        surface().view()


def test_the_library_is_loaded_when_it_is_asked_for() -> None:
    loaded = processes.run("import sys, impasto, impasto.viewer; print('anywidget' in sys.modules)")
    assert loaded.strip() == "False"


def test_a_store_is_shown_by_the_tiles_that_are_seen(tmp_path: Path) -> None:
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]]
    stack = impasto.Stack(surface().predict(lights), lights=lights)
    result = impasto.fit_sbrdf(stack, pooling="none", check=False)
    result.save(tmp_path / "a.zarr")
    for shown in (result, impasto.open_sbrdf(tmp_path / "a.zarr")):
        document = json.loads(shown.view(title="Icon").document)
        assert (document["title"], document["width"], document["height"]) == ("Icon", 30, 20)
