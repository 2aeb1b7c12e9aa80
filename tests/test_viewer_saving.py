"""Pictures in linear light that the page saves, read as other programs read OpenEXR."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

import chromium
import impasto
from impasto.viewer import write_site
from impasto.viewer.scripts import page_file
from test_viewer import LAMP, surfaces

SAVED = (
    "(async turns => { const { viewer } = window.impasto;"
    " viewer.set({ ...viewer.first, turns }); await viewer.environment();"
    " const saved = []; const kept = URL.createObjectURL;"
    " URL.createObjectURL = blob => { saved.push(blob); return kept(blob); };"
    " await viewer.savePicture('exr'); URL.createObjectURL = kept;"
    " const bytes = new Uint8Array(await saved[0].arrayBuffer());"
    " let text = ''; for (const byte of bytes) text += String.fromCharCode(byte);"
    " return btoa(text); })"
)


@pytest.mark.parametrize("name", ["pixels", "spectra"])
def test_linear_light_is_that_of_the_renderer(
    browser: chromium.Chromium, tmp_path: Path, name: str
) -> None:
    """Half precision of the file and of the colours on the page: 2^-11 of a number each.

    A normal of 16 bits changes the narrowest lobe by 5e-4 (``test_viewer.py``), and a saturated
    colour is a difference of larger numbers: 1e-3 of white more.
    """
    surface, spectra = surfaces()[name]
    write_site(surface, tmp_path / "site", reflectance=spectra)
    browser.open((tmp_path / "site" / "index.html").as_uri())
    scene = impasto.Scene([LAMP(np.pi / 2, np.pi / 4)])
    image = impasto.render(surface, scene, reflectance=spectra)
    expected = np.where(image.coverage > 0, np.nan_to_num(image.linear), 0.0)
    assert expected.max() > 1.0, "light above the display's white is kept"
    for turns in range(4):
        path = tmp_path / f"{turns}.exr"
        path.write_bytes(base64.b64decode(browser.value(f"{SAVED}({turns})")))
        found = impasto.io.read_image(path)
        turned = np.rot90(expected, turns, axes=(1, 2))
        assert found.shape == turned.shape
        assert np.allclose(found, turned, rtol=2.0**-10 + 5e-4, atol=1e-3)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            assert {one: channels[one].pixels.dtype for one in "RGB"} == dict.fromkeys(
                "RGB", np.float16
            )
            assert np.array_equal(channels["R"].pixels.astype(np.float32), found[0])


def test_half_precision_is_rounded_as_numpy_rounds(
    browser: chromium.Chromium, tmp_path: Path
) -> None:
    """Every half, the values half way between two, and their neighbours in single precision."""
    (tmp_path / "empty.html").write_text("<!doctype html><html data-ready='1'></html>", "utf-8")
    browser.open((tmp_path / "empty.html").as_uri())
    halves = np.arange(0x7C00, dtype=np.uint16).view(np.float16).astype(np.float32)
    middles = 0.5 * (halves[1:] + halves[:-1])
    near = [np.nextafter(middles, np.float32(far)) for far in (0.0, np.inf)]
    values = np.concatenate([halves, middles, *near])
    values = np.concatenate([values, -values[::7]])
    words = base64.b64encode(values.tobytes()).decode()
    module = page_file("half.js").replace("export ", "")
    found = browser.value(
        f"(text => {{ {module}"
        " const bytes = Uint8Array.from(atob(text), one => one.charCodeAt(0));"
        " return [...new Float32Array(bytes.buffer)].map(toHalf); })"
        f"('{words}')"
    )
    assert np.array_equal(np.array(found, np.uint16), values.astype(np.float16).view(np.uint16))
