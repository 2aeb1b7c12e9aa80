"""The page by hand: fingers, mouse, keyboard and files, from a press to what is on the disk."""

from __future__ import annotations

import json
import re
import uuid
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import chromium
import impasto
from impasto.viewer import write_site
from test_viewer import LAMP, SHAPE, surfaces

VIEWER = "window.impasto.viewer"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> str:
    surface, _ = surfaces()["pixels"]
    folder = tmp_path_factory.mktemp("pages") / "site"
    write_site(surface, folder, title="Icon", pitch_mm=0.5)
    return (folder / "index.html").as_uri()


@pytest.fixture
def page(browser: chromium.Chromium, site: str) -> Iterator[chromium.Chromium]:
    """As somebody opens it: nothing has the focus."""
    browser.open(site)
    yield browser
    browser.value("localStorage.clear()")


def stage(page: chromium.Chromium) -> tuple[float, float]:
    """The middle of the painting's part of the page."""
    box = page.value(
        f"(() => {{ const b = {VIEWER}.canvas.getBoundingClientRect();"
        " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )
    return box[0], box[1]


def state(page: chromium.Chromium) -> dict[str, Any]:
    return dict(page.value(f"{VIEWER}.state"))


def button(page: chromium.Chromium, words: str) -> None:
    """Press a button of the panel by its words."""
    page.value(
        "(() => { const one = [...document.querySelectorAll('aside button')]"
        f".find(made => made.textContent === {json.dumps(words)});"
        " one.closest('details').open = true; one.scrollIntoView(); one.id = 'pressed'; })()"
    )
    page.click("#pressed")
    page.value("document.querySelector('#pressed').removeAttribute('id')")


def test_two_fingers_zoom_and_move_and_leave_the_light(page: chromium.Chromium) -> None:
    """What lies under the fingers stays under them, so the zoom is the ratio of their distances."""
    page.key("1")
    page.until(f"{VIEWER}.state.view !== null")
    before = state(page)
    zoom, (x, y) = before["view"][2], stage(page)
    page.touch((x - 30, y))
    page.touch((x - 30, y), (x + 30, y))
    for step in range(1, 5):
        page.touch((x - 30 - 10 * step, y), (x + 30 + 10 * step, y))
    # Twice the distance, and then 25 pixels to the right, 15 down.
    page.touch((x - 45, y + 15), (x + 95, y + 15))
    # A third finger changes nothing.
    page.touch((x - 45, y + 15), (x + 95, y + 15), (x, y + 60))
    page.touch()
    after = state(page)
    ratio = 140 / 60
    assert after["view"][2] == pytest.approx(zoom * ratio, rel=1e-6)
    # The middle of the fingers was on the middle of the view.
    moved = [before["view"][0] - 25 / (zoom * ratio), before["view"][1] - 15 / (zoom * ratio)]
    assert after["view"][:2] == pytest.approx(moved, abs=1e-6)
    lamp = ("azimuth", "elevation", "environment")
    assert [after[name] for name in lamp] == [before[name] for name in lamp]


def test_one_finger_moves_the_light_and_the_painting(page: chromium.Chromium) -> None:
    x, y = stage(page)
    page.touch((x, y))
    page.touch((x + 60, y))
    page.touch()
    moved = state(page)
    assert moved["azimuth"] == pytest.approx(0.0, abs=1e-9), "the lamp stands where the finger is"
    # 60 of the 0.48 half sides from the middle to where light grazes.
    height = page.value(f"Math.min({VIEWER}.canvas.clientHeight, {VIEWER}.canvas.clientWidth)")
    assert moved["elevation"] == pytest.approx(np.degrees(np.arccos(60 / (0.48 * height))))
    page.key("m")
    page.key("1")
    view = state(page)["view"]
    page.touch((x, y))
    page.touch((x - 14, y + 6))
    page.touch()
    assert state(page)["view"][:2] == pytest.approx([view[0] + 14, view[1] - 6])


def test_a_note_is_drawn_kept_saved_and_opened_again(
    page: chromium.Chromium, site: str, tmp_path: Path
) -> None:
    """Pixel for pixel the page's pixels are the painting's: the rectangle is known in advance."""
    page.key("n")
    page.key("1")
    view = state(page)["view"]
    x, y = stage(page)
    left, top = 8, 6
    start = (x + left - view[0], y + top - view[1])
    page.drag(start, (start[0] + 12, start[1] + 9))
    page.until("document.querySelector('dialog textarea') === document.activeElement")
    page.write("Loss of paint; filled?")
    page.click("dialog .main")
    page.until("document.querySelector('dialog') === null")
    page.open(site)
    assert page.value("document.querySelectorAll('.over .note').length") == 1, "kept by the browser"
    file = page.saved(tmp_path / "notes", lambda: button(page, "Save notes"))
    assert file.name == "notes.jsonld"
    saved = json.loads(file.read_text("utf-8"))
    # Web Annotation Data Model, sections 3 and 5.2: what a page and an annotation must have.
    assert saved["@context"] == "http://www.w3.org/ns/anno.jsonld"
    assert saved["type"] == "AnnotationPage"
    (note,) = saved["items"]
    assert note["type"] == "Annotation"
    for identified in (saved, note):
        assert uuid.UUID(identified["id"].removeprefix("urn:uuid:")).variant == uuid.RFC_4122
    assert datetime.fromisoformat(note["created"]).tzinfo is not None
    assert note["body"] == {
        "type": "TextualBody", "value": "Loss of paint; filled?", "format": "text/plain",
    }  # fmt: skip
    assert note["target"]["source"] == site
    found = re.fullmatch(r"xywh=pixel:(\d+),(\d+),(\d+),(\d+)", note["target"]["selector"]["value"])
    assert found is not None
    assert [int(one) for one in found.groups()] == pytest.approx([left, top, 12, 9], abs=1)
    page.click("[aria-label='Remove note 1']")
    page.open(site)
    assert page.value(f"{VIEWER}.notes") == []
    page.choose_file("input[type=file]", file)
    page.until(f"{VIEWER}.notes.length === 1")
    assert page.value(f"{VIEWER}.notes") == [note]
    page.choose_file("input[type=file]", file)
    page.value("new Promise(done => setTimeout(done, 100))")
    assert page.value(f"{VIEWER}.notes.length") == 1, "the same note is the same"


def test_what_is_no_note_is_refused_in_words(page: chromium.Chromium, tmp_path: Path) -> None:
    said = "document.querySelector('.said').textContent"
    outside = '{"target": {"selector": {"value": "xywh=pixel:900,0,3,3"}}}'
    for text in ("{", "[]", "null", outside):
        words = "no JSON" if text == "{" else "no notes on this painting"
        (tmp_path / "bad.json").write_text(text, "utf-8")
        page.value("document.querySelector('.said').textContent = ''")
        page.choose_file("input[type=file]", tmp_path / "bad.json")
        assert words in page.until(said)
        assert page.value(f"{VIEWER}.notes") == []


def test_a_note_needs_no_pointer(page: chromium.Chromium) -> None:
    """The keyboard alone: N, Enter, words, Tab to Keep, Enter."""
    page.key("n")
    page.key("1")
    page.key("Enter")
    page.until("document.querySelector('dialog textarea') === document.activeElement")
    page.write("by the keyboard")
    page.value("document.querySelector('dialog .main').focus()")
    page.call("Input.dispatchKeyEvent", type="keyDown", key="Enter", text="\r")
    page.until(f"{VIEWER}.notes.length === 1")
    (note,) = page.value(f"{VIEWER}.notes")
    # All of the painting is seen, and a note lies within it.
    assert note["target"]["selector"]["value"] == f"xywh=pixel:0,0,{SHAPE[1]},{SHAPE[0]}"


def test_keys_work_before_anything_is_touched(page: chromium.Chromium) -> None:
    assert page.value("document.activeElement === document.body")
    page.key("r")
    assert (state(page)["azimuth"], state(page)["elevation"]) == (180, 10)
    page.key("ArrowUp")
    assert state(page)["azimuth"] < 180
    page.key("h")
    assert page.value("document.querySelector('.bare') !== null")


@pytest.mark.parametrize("kind", ["PNG", "EXR"])
def test_a_picture_on_the_disk_is_that_of_the_renderer(
    page: chromium.Chromium, tmp_path: Path, kind: str
) -> None:
    """One code, as ``test_viewer.py`` says; linear light as ``test_viewer_saving.py`` says."""
    page.key("r")
    file = page.saved(tmp_path / "pictures", lambda: button(page, f"Save {kind}"))
    assert file.name == f"Icon.{kind.lower()}"
    scene = impasto.Scene([LAMP(np.pi, np.radians(10))], exposure=2**2.5)
    image = impasto.render(surfaces()["pixels"][0], scene)
    if kind == "PNG":
        codes = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert codes.shape == (*SHAPE, 4)
        known = image.coverage > 0
        assert np.array_equal(codes[..., 3] > 0, known)
        found = codes[..., 2::-1].astype(int)[known]
        assert np.abs(found - image.display[known]).max() <= 1
        assert image.display[known].std() > 5
    else:
        expected = np.where(image.coverage > 0, np.nan_to_num(image.linear), 0.0)
        found = impasto.io.read_image(file)
        assert np.allclose(found, expected, rtol=2.0**-10 + 5e-4, atol=1e-3)
