"""What was measured at a pixel beside what was fitted: the server's numbers and the page's plot."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import chromium
import impasto
from impasto.cli.console import Stages
from impasto.cli.page import WHOLE, photographs_beside
from impasto.fit.relief import Relief
from impasto.simulate import camera
from impasto.surface import Surface
from impasto.viewer import Contents, ViewServer, write_site
from loopback import request, serving

SHAPE = (20, 30)
PLACE = (7, 21)
WHITE = 50_000.0
LAMPS = [
    impasto.PointLight((x, y, z), 1.2)
    for x, y, z in [
        (30, 0, 30), (-30, 0, 30), (0, 30, 30), (0, -30, 30), (-28, 8, 45), (40, 9, 6),
        (-9, 40, 20),
    ]
]  # fmt: skip


def photographed() -> impasto.Stack:
    """Codes of a glossy surface in near lamps: some clipped, some of lamps behind the horizon."""
    random = np.random.default_rng(3)
    normal = np.concatenate([random.normal(0.0, 0.2, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal[:, *PLACE] = (-0.5, 0.1, 0.8)
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = random.uniform(0.2, 0.7, (3, *SHAPE))
    diffuse[:, *PLACE] = (0.9, 0.5, 0.3)
    surface = Surface.torrance_sparrow(normal, diffuse, 3.0, 0.2, pitch_mm=1.0)
    rig = impasto.Rig(LAMPS, pitch_mm=1.0)
    light = surface.predict(rig) + random.normal(0.0, 2e-3, (len(LAMPS), 3, *SHAPE))
    codes = np.clip(np.rint(WHITE * light) + 100, 0, 48_000).astype(np.uint16)
    mask = np.ones(SHAPE, bool)
    mask[0, 0] = False
    return impasto.Stack(
        codes, lights=rig, scale=1 / WHITE, black=100, saturation=48_000, mask=mask
    )


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    return photographed()


@pytest.fixture(scope="module")
def fitted(stack: impasto.Stack) -> impasto.Sbrdf:
    return impasto.fit_sbrdf(stack, pooling="painting", check=False)


@pytest.fixture(scope="module")
def page(fitted: impasto.Sbrdf, stack: impasto.Stack) -> Iterator[ViewServer]:
    with serving(ViewServer(Contents(fitted, stack=stack, title="Icon"))) as server:
        yield server


def said(contents: Contents, row: int, column: int) -> dict[str, Any]:
    make = contents.data(f"samples/{row}-{column}")
    assert make is not None
    return dict(json.loads(make()))


def numbers(values: Any) -> NDArray[np.float64]:
    return np.array(values, dtype=np.float64)  # null is NaN


def test_a_pixel_has_its_samples_and_what_the_whole_fit_predicts(
    fitted: impasto.Sbrdf, stack: impasto.Stack
) -> None:
    """In plain numpy from the codes and the geometry; predictions are those of the whole painting.

    Numbers have six digits: half of the last is 5e-6 of a number that begins with 1.
    """
    row, column = PLACE
    found = said(Contents(fitted, stack=stack), row, column)
    codes = np.asarray(stack.samples)[:, :, row, column].astype(float)
    clipped = codes >= 48_000
    light = np.where(clipped, 47_900 / WHITE, (codes - 100) / WHITE)
    model = fitted.predict(fidelity="model")[:, :, row, column]
    assert found["bands"] == ["red", "green", "blue"]
    assert np.allclose(numbers(found["ceiling"]), 47_900 / WHITE, rtol=6e-6)
    assert np.allclose(numbers(found["measured"]), light, rtol=6e-6, atol=0)
    assert np.allclose(numbers(found["fitted"]), model, rtol=6e-6, atol=1e-9)
    assert found["clipped"] == clipped.tolist()
    # The middle of the pixel in mm, rows down.
    place = np.array([column + 0.5 - 15, 10 - row - 0.5, 0.0])
    towards = np.array([lamp.position for lamp in LAMPS]) - place
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    half = towards + np.array([0, 0, 1])
    half /= np.linalg.norm(half, axis=1)[:, None]
    normal = fitted.normal[:, row, column].astype(float)
    assert np.allclose(numbers(found["angle"]), np.degrees(np.arccos(half @ normal)), atol=1e-3)
    behind = towards @ normal <= 0
    assert found["shadowed"] == behind.tolist()
    assert behind.any()
    assert clipped.any(), "the pixel has samples of every kind"
    good = ~clipped & ~behind[:, None]
    residual = np.sqrt(np.mean((model - light)[good] ** 2)) / light[good].max()
    assert found["residual"] == pytest.approx(residual, rel=1e-3)
    assert 1e-4 < residual < 0.2


def test_the_shadows_of_the_painting_s_own_relief_are_marked(fitted: impasto.Sbrdf) -> None:
    """A wall between the lamps at the right and the pixel; the model is that of the whole."""
    height = np.zeros(SHAPE, np.float32)
    height[:, 25] = 30.0
    relief = Relief(
        height, fitted.normal, fitted.diffuse, 1, np.zeros(2), False, white=1.0, gain=1.0
    )
    walled = replace(fitted, relief=relief)
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.3, 0.0, 0.954]]
    stack = impasto.Stack(np.full((3, 3, *SHAPE), 0.3, np.float32), lights=lights)
    row, column = 12, 20
    found = said(Contents(walled, stack=stack), row, column)
    # 5 pixels off and 30 high: the lamp in front is hidden up to atan(30 / 5) = 81 degrees.
    assert found["shadowed"] == [True, False, True]
    whole = walled.predict(stack.rig, fidelity="model")[:, :, row, column]
    assert np.allclose(numbers(found["fitted"]), whole, rtol=6e-6, atol=1e-9)


def test_a_pixel_that_was_not_fitted_has_measured_samples_alone(
    fitted: impasto.Sbrdf, stack: impasto.Stack
) -> None:
    found = said(Contents(fitted, stack=stack), 0, 0)
    assert np.isfinite(numbers(found["measured"])).all()
    assert np.isnan(numbers(found["fitted"])).all()
    assert np.isnan(numbers(found["angle"])).all()
    assert found["residual"] is None


def test_only_the_pixel_is_read(
    fitted: impasto.Sbrdf, stack: impasto.Stack, tmp_path: Path
) -> None:
    """Of a store and of a source of windows, and of a result in some of its bands."""
    asked: list[tuple[slice, slice]] = []

    class Source:
        shape = stack.shape

        def window(self, rows: slice, columns: slice) -> impasto.Stack:
            asked.append((rows, columns))
            return stack[rows, columns]

    fitted.save(tmp_path / "a.impasto.zarr")
    expected = said(Contents(fitted, stack=stack), *PLACE)
    stored = impasto.open_sbrdf(tmp_path / "a.impasto.zarr")
    contents = Contents(stored, stack=Source())
    assert asked == []
    assert said(contents, *PLACE) == expected
    row, column = PLACE
    assert asked == [(slice(row, row + 1), slice(column, column + 1))]
    one = said(Contents(stored[:, :].with_bands([0]), stack=stack_of(stack, 1)), *PLACE)
    assert one["bands"] == ["red"]
    assert one["measured"] == [light[:1] for light in expected["measured"]]


def test_the_command_opens_photographs_of_a_large_painting_without_reading_them(
    fitted: impasto.Sbrdf, stack: impasto.Stack, tmp_path: Path
) -> None:
    """What a click says is what it says of photographs in memory; none is shown whole."""
    impasto.io.write_stack(tmp_path / "stack.npz", stack)
    whole = photographs_beside(tmp_path / "stack.npz", None, Stages(quiet=True), WHOLE)
    assert isinstance(whole, impasto.Stack)
    opened = photographs_beside(tmp_path / "stack.npz", None, Stages(quiet=True), WHOLE + 1)
    assert not isinstance(opened, impasto.Stack)
    contents = Contents(fitted, stack=opened)
    assert said(contents, *PLACE) == said(Contents(fitted, stack=whole), *PLACE)
    assert contents.document["photographs"] == []


def stack_of(stack: impasto.Stack, bands: int) -> impasto.Stack:
    """The first bands of a stack."""
    samples = np.ascontiguousarray(stack.samples[:, :bands])
    options = {name: getattr(stack, name)[:bands] for name in ("scale", "black", "saturation")}
    return impasto.Stack(samples, lights=stack.rig, bands=stack.bands[:bands], **options)


@pytest.mark.parametrize("name", ["20-0", "0-30", "-1-0", "0", "0-0-0", "99999999-0", "0x1-0"])
def test_no_other_pixel_can_be_asked_for(page: ViewServer, name: str) -> None:
    assert request(page, f"/{page.token}/samples/{name}.js").status == 404


def test_samples_need_the_token_and_the_host(page: ViewServer) -> None:
    assert request(page, f"/{page.token}/samples/7-21.js").status == 200
    assert request(page, "/samples/7-21.js").status == 403
    assert request(page, f"/{page.token}/samples/7-21.js", Host="evil.example").status == 403


MARKS = """
(() => {
  const picture = document.querySelector('.taken svg');
  const lines = [...picture.querySelectorAll('.grid')].map(one => Number(one.getAttribute('y1')));
  const ends = [...picture.querySelectorAll('.tick[text-anchor=end]')];
  const lights = ends.map(one => Number(one.textContent));
  const groups = [...picture.querySelectorAll('.samples')].map(group =>
    [...group.querySelectorAll('path')].map((one, i) => ({
      kind: one.getAttribute('class'), words: one.textContent,
      from: Number(group.querySelectorAll('line')[i].getAttribute('y1')),
      to: Number(group.querySelectorAll('circle')[i].getAttribute('cy')),
      at: Number(group.querySelectorAll('circle')[i].getAttribute('cx')) })));
  return { lines, lights, groups };
})()
"""


def test_the_page_draws_what_the_server_says(
    browser: chromium.Chromium, page: ViewServer, fitted: impasto.Sbrdf, stack: impasto.Stack
) -> None:
    """By the lines of the diagram: light goes by its square root between those of 0 and another.

    SVG has places to a hundredth or better, of 138 for the brightest sample.
    """
    row, column = PLACE
    expected = said(Contents(fitted, stack=stack), row, column)
    browser.open(f"{page.url}#pixel={column},{row}")
    browser.until("document.querySelector('.taken .samples') !== null")
    found = browser.value(MARKS)
    lights, lines = numbers(found["lights"]), numbers(found["lines"])
    assert lights[0] == 0
    assert len(lights) >= 3, "0 and two others"
    scale = (lines[0] - lines[1]) / np.sqrt(lights[1])
    assert np.allclose(lines[0] - scale * np.sqrt(lights), lines, atol=0.01)
    assert len(found["groups"]) == 3
    for band, marks in enumerate(found["groups"]):
        assert len(marks) == len(LAMPS)
        for which, mark in enumerate(marks):
            measured, fit = (expected[name][which][band] for name in ("measured", "fitted"))
            for end, light in (("from", measured), ("to", fit)):
                height = scale * np.sign(light) * np.sqrt(abs(light))
                assert mark[end] == pytest.approx(lines[0] - height, abs=0.02)
            kind = "clipped" if expected["clipped"][which][band] else (
                "shadowed" if expected["shadowed"][which] else "measured")  # fmt: skip
            assert mark["kind"] == kind
            words = re.fullmatch(r"No\. (\d), (\w+): (\S+), fitted (\S+)", mark["words"])
            assert words is not None
            assert (words[1], words[2]) == (str(which + 1), expected["bands"][band])
            # Three digits.
            assert (float(words[3]), float(words[4])) == pytest.approx((measured, fit), rel=6e-3)
        order = np.argsort([mark["at"] for mark in marks])
        assert (np.diff(numbers(expected["angle"])[order]) >= 0).all()
    words = browser.value("document.querySelector('.taken').textContent")
    percent = re.search(r"Residual ([\d.]+) % of the brightest", words)
    assert percent is not None
    assert float(percent[1]) == pytest.approx(100 * expected["residual"], rel=0.05)
    assert "triangles are clipped, crosses in shadow" in words


def test_arrows_move_the_place_that_is_inspected(
    browser: chromium.Chromium, page: ViewServer
) -> None:
    browser.open(page.url)
    light = browser.value("window.impasto.viewer.state.azimuth")
    browser.value("window.impasto.viewer.canvas.focus()")
    browser.key("i")
    pixel = "window.impasto.viewer.state.pixel"
    browser.key("ArrowRight")
    assert browser.value(pixel) == [15, 9], "the middle of what is seen"
    browser.key("ArrowDown")
    browser.key("ArrowRight", shift=True)
    assert browser.value(pixel) == [25, 10]
    browser.key("ArrowRight", shift=True)
    assert browser.value(pixel) == [29, 10], "the last column"
    browser.until("document.querySelector('.taken .samples') !== null")
    assert "column 29, row 10" in browser.value("document.querySelector('dl.values').textContent")
    # Where the picture is turned, right is right on the page.
    browser.key("t")
    before = browser.value("window.impasto.viewer.toCanvas([29, 10])")
    browser.key("ArrowLeft")
    after = browser.value(f"window.impasto.viewer.toCanvas({pixel})")
    assert after[0] < before[0]
    assert after[1] == pytest.approx(before[1])
    assert browser.value("window.impasto.viewer.state.azimuth") == light


def test_a_page_on_a_disk_says_where_samples_are_seen(
    browser: chromium.Chromium, fitted: impasto.Sbrdf, stack: impasto.Stack, tmp_path: Path
) -> None:
    write_site(fitted, tmp_path / "site", stack=stack)
    assert not (tmp_path / "site" / "samples").exists()
    browser.open((tmp_path / "site" / "index.html").as_uri() + "#pixel=21,7")
    browser.until("document.querySelector('dl.values') !== null")
    words = browser.value("document.querySelector('.taken').textContent")
    assert "impasto view with --photographs" in words
    assert browser.value("document.querySelector('.taken svg')") is None
    assert browser.value("getComputedStyle(document.querySelector('.taken')).opacity") == "1"
    names = browser.value("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert not [name for name in names if "samples" in name]


def test_samples_that_cannot_be_read_are_named_calmly(
    browser: chromium.Chromium, fitted: impasto.Sbrdf, stack: impasto.Stack
) -> None:
    class Gone:
        shape = stack.shape

        def window(self, rows: slice, columns: slice) -> impasto.Stack:
            raise OSError(2, "No such file or directory", "photo.tif")

    with serving(ViewServer(Contents(fitted, stack=Gone()))) as server:
        answer = request(server, f"/{server.token}/samples/7-21.js")
        assert (answer.status, answer.error) == (500, "photo.tif: No such file or directory")
        browser.open(f"{server.url}#pixel=21,7")
        browser.until("document.querySelector('.taken').textContent.includes('not be read')")


def test_a_spectrum_has_its_interval(browser: chromium.Chromium, fitted: impasto.Sbrdf,
                                     tmp_path: Path) -> None:  # fmt: skip
    """That of :meth:`impasto.Reflectance.interval`, cut off where the diagram ends.

    Coefficients are kept in half precision, 5e-4 of the spectrum, and the diagram has 96 rows.
    """
    spectra = impasto.fit_reflectance(None, fitted, camera("rgb"))
    row, column = PLACE
    limits, curve = spectra.interval(row, column), spectra.spectrum(row, column)
    assert limits is not None
    write_site(fitted, tmp_path / "site", reflectance=spectra)
    browser.open((tmp_path / "site" / "index.html").as_uri() + f"#pixel={column},{row}")
    browser.until("document.querySelector('.band') !== null")
    lines, lights, band, line = browser.value(
        "(() => { const picture = document.querySelector('.band').parentElement;"
        "const all = name => [...picture.querySelectorAll(name)];"
        "const rows = text => text.slice(1).split('L').map(one => Number(one.split(' ')[1]));"
        "return [all('.grid').map(one => Number(one.getAttribute('y1'))),"
        "  all('.tick[text-anchor=end]').map(one => Number(one.textContent)),"
        "  ...['.band', '.curve'].map(name => rows(all(name)[0].getAttribute('d')))]; })()"
    )
    least, most = min(0.0, curve.min()), max(1.0, np.ceil(5 * curve.max()) / 5)

    def reflectance(rows: Any) -> NDArray[np.float64]:
        return (lines[0] - numbers(rows)) / (lines[0] - lines[-1]) * lights[-1]

    assert np.allclose(reflectance(line), curve, atol=2e-3)
    upper, lower = reflectance(band[: len(curve)]), reflectance(band[len(curve) :][::-1])
    assert np.allclose(lower, np.clip(limits[0], least, most), atol=2e-3)
    assert np.allclose(upper, np.clip(limits[1], least, most), atol=2e-3)
    assert (limits[1] - limits[0]).mean() > 0.02, "the band is seen"
    words = browser.value("document.querySelector('aside').textContent")
    assert "The band holds 95 % of the errors on training spectra." in words


def test_a_notebook_answers_with_samples(fitted: impasto.Sbrdf, stack: impasto.Stack) -> None:
    widget = fitted.view(stack=stack)
    answers: list[tuple[Any, Any]] = []
    widget.send = lambda content, buffers=None: answers.append((content, buffers))
    widget._handle_custom_msg({"file": "samples/7-21"}, [])
    ((content, (data,)),) = answers
    assert content == {"file": "samples/7-21"}
    assert json.loads(data) == said(Contents(fitted, stack=stack), *PLACE)
    assert json.loads(widget.document)["samples"] is True


def test_photographs_of_another_painting_are_refused(fitted: impasto.Sbrdf) -> None:
    lights = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.0, 1.0]]
    other = impasto.Stack(np.zeros((3, 3, 5, 6), np.float32), lights=lights)
    with pytest.raises(impasto.ArgumentError, match="20 x 30 pixels, as the result has, found 5"):
        Contents(fitted, stack=other)
    with pytest.raises(impasto.ArgumentError, match=r"stack: expected an impasto\.Stack"):
        Contents(fitted, stack="photographs")
