"""What notebooks show, pictures as arrays and files, and input that names its own dimensions."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
import warnings
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

import impasto
from impasto import ArgumentError, DistantLight, Scene
from test_crop_and_rotate import lit
from test_sbrdf_xarray import KINDS

LIGHTS = [(0.0, 0.6, 0.8), (0.6, 0.0, 0.8), (-0.6, 0.0, 0.8), (0.0, -0.6, 0.8)]


def samples() -> Any:
    """Four photographs of three bands, 5 x 7 pixels; every number differs."""
    return np.linspace(0.1, 0.9, 4 * 3 * 5 * 7).astype(np.float32).reshape(4, 3, 5, 7)


def surface() -> impasto.Surface:
    normal = np.zeros((3, 5, 7), np.float32)
    normal[2] = 1.0
    return impasto.Surface(normal, samples()[0])


@pytest.fixture(scope="module")
def image() -> impasto.Image:
    return impasto.render(surface(), Scene([DistantLight((0, 0.5, 1))]))


def test_a_stack_shows_its_sizes_and_a_thumbnail() -> None:
    page = impasto.Stack(samples(), lights=LIGHTS, bands=("<red>", "g", "b"))._repr_html_()
    for part in ("7 x 5 pixels", "&lt;red&gt;, g, b", "float32", "4 lights"):
        assert part in page
    assert "mean of 4 photographs" in page
    assert [picture.shape for picture in pictures(page)] == [(5, 7, 3)]


def pictures(page: str) -> list[Any]:
    """The embedded pictures of a notebook view, red first."""
    coded = re.findall(r"data:image/png;base64,([^']+)'", page)
    found = [np.frombuffer(base64.b64decode(one), np.uint8) for one in coded]
    return [cv2.imdecode(one, cv2.IMREAD_COLOR)[..., ::-1] for one in found]


def fit() -> impasto.PooledSbrdf:
    return impasto.fit_sbrdf(
        impasto.Stack(samples(), lights=LIGHTS, bands=("<b>", "g", "b")), pooling="painting"
    )


def stored(folder: Path) -> impasto.StoredSbrdf:
    fit().save(folder / "<i>.zarr")
    return impasto.open_sbrdf(folder / "<i>.zarr")


VIEWS: dict[str, Any] = {
    "stack": lambda _: impasto.Stack(samples(), lights=LIGHTS),
    "normals": lambda _: impasto.fit_normals(impasto.Stack(samples(), lights=LIGHTS)),
    "result": lambda _: fit(),
    "store": stored,
    "plan": lambda _: impasto.plan(surface(), Scene([DistantLight((0, 0.5, 1))])),
    "comparison": lambda _: impasto.compare(fit(), fit(), align="same"),
}


@pytest.mark.parametrize("name", VIEWS)
def test_a_view_is_html_that_closes_what_it_opens(name: str, tmp_path: Path) -> None:
    """Whatever follows in the notebook would otherwise stand inside the view.

    Only tags of the view itself are open: names of bands and files are text. Nothing is loaded
    from anywhere, and the colours are those of the page, which may be dark.
    """
    view = VIEWS[name](tmp_path)._repr_html_()
    opened: list[str] = []
    seen: set[str] = set()

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: Any) -> None:
            seen.add(tag)
            for key, value in attrs:
                assert not key.startswith("on")
                assert key not in {"href", "srcset"}
                assert key != "src" or str(value).startswith("data:image/png;base64,")
                assert "url(" not in str(value)
            if tag != "img":
                opened.append(tag)

        def handle_endtag(self, tag: str) -> None:
            assert opened.pop() == tag

    Reader().feed(view)
    assert opened == []
    assert seen <= {"div", "table", "caption", "b", "tr", "td", "figure", "img", "figcaption"}
    assert re.findall(r"(?<!caption-)(?:color|background):(?!inherit|none)", view) == []


def test_a_plan_shows_a_row_for_every_effect() -> None:
    planned = impasto.plan(surface(), Scene([DistantLight((0, 0.5, 1))]))
    page = planned._repr_html_()
    for effect in planned.effects:
        assert f">{effect.name}</td>" in page
    assert "tolerance 0" in page


def test_a_store_shows_what_its_result_shows(tmp_path: Path) -> None:
    page = stored(tmp_path)._repr_html_()
    for part in ("7 x 5 pixels", "&lt;b&gt;, g, b", "PooledSbrdf in tiles of", "&lt;i&gt;.zarr"):
        assert part in page
    assert [one.tolist() for one in pictures(page)] == [
        one.tolist() for one in pictures(fit()._repr_html_())
    ]


def test_pictures_stay_small_where_nothing_can_be_compressed() -> None:
    """A notebook keeps every view in its file: noise is reduced until it fits."""
    rng = np.random.default_rng(1)
    noise = rng.random((3, 3, 470, 470), dtype=np.float32)
    page = impasto.Stack(noise, lights=LIGHTS[:3])._repr_html_()
    # Four characters of base64 for three bytes, and the words.
    assert len(page) < 4 / 3 * 160_000 + 4000
    (picture,) = pictures(page)
    assert min(picture.shape[:2]) >= 100


def test_views_are_imported_when_one_is_shown() -> None:
    script = "import sys, impasto; print('impasto.notebook' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


def test_normals_show_their_method_their_error_and_two_maps() -> None:
    normals = impasto.fit_normals(impasto.Stack(samples(), lights=LIGHTS), method="least-squares")
    page = normals._repr_html_()
    error = f"{np.degrees(np.nanmedian(normals.sigma)):.2g}° (median)"
    for part in ("Normals", "7 x 5 pixels", "least-squares", "100.0 %", error):
        assert part in page
    _, coded = pictures(page)
    np.testing.assert_array_equal(
        coded, np.rint(127.5 * (np.moveaxis(normals.normal, 0, -1) + 1.0)).astype(np.uint8)
    )


def test_normals_without_an_estimate_say_so() -> None:
    dark = impasto.fit_normals(impasto.Stack(0.0 * samples(), lights=LIGHTS))
    page = dark._repr_html_()
    assert "unknown" in page
    assert ">0.0 %<" in page
    assert len(pictures(page)) == 2


def test_a_reflectance_shows_its_colours_under_daylight() -> None:
    """A spectrum that reflects long wavelengths only is red, whatever the basis."""
    grid = np.arange(400.0, 701.0, 10.0)
    basis = np.array([grid > 600.0, grid <= 600.0], dtype=np.float64)
    coefficients = np.zeros((2, 3, 4), np.float32)
    coefficients[0, :, :2] = coefficients[1, :, 2:] = 1.0
    status = np.zeros((3, 4), np.uint8)
    found = impasto.Reflectance(coefficients, basis, grid, status, {"estimator": "wiener"})
    page = found._repr_html_()
    for part in ("Reflectance", "4 x 3 pixels", "2 spectra, 400 to 700 nm", "wiener", "100.0 %"):
        assert part in page
    (picture,) = pictures(page)
    red, cyan = picture[0, 0].astype(int), picture[0, 3].astype(int)
    assert red[0] > 2 * red[1:].max()
    # 600 nm is orange: what ends there has some red left.
    assert 1.5 * cyan[0] < cyan[1:].min()


@KINDS
def test_a_result_shows_its_gloss_and_two_maps(make: Any) -> None:
    """One row where one lobe was fitted; the median lobe as well where there are many."""
    result = lit(make())
    page = result._repr_html_()
    assert type(result).__name__ in page
    assert ("median lobe" in page) == (result.gloss.source == "pixels")
    assert "nan" not in page.split("<img")[0]
    assert [picture.shape for picture in pictures(page)] == 2 * [(*result.shape, 3)]


def test_a_thumbnail_of_nothing_is_black() -> None:
    empty = np.full((2, 1, 4, 4), np.nan, np.float32)
    page = impasto.Stack(empty, lights=LIGHTS[:2])._repr_html_()
    assert "data:image/png" in page


def test_a_picture_is_an_array_and_a_png(image: impasto.Image) -> None:
    np.testing.assert_array_equal(np.asarray(image), image.display)
    assert np.asarray(image, dtype=np.float32).dtype == np.float32
    coded = cv2.imdecode(np.frombuffer(image._repr_png_(), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(coded[..., ::-1], image.display)


def test_a_picture_is_saved_by_its_suffix(image: impasto.Image, tmp_path: Path) -> None:
    for name in ("a.png", "a.jpg", "a.JPEG", "a.tif", "a.tiff", "a.exr"):
        image.save(tmp_path / name)
    # 16-bit codes are those of the linear light; 8-bit ones are the same, rounded: half a code.
    deep = tifffile.imread(tmp_path / "a.tif")
    assert deep.dtype == np.uint16
    assert np.abs(deep / 257.0 - image.display).max() <= 0.51
    # JPEG loses a few codes, and keeps the picture.
    coded = cv2.imread(str(tmp_path / "a.jpg"))[..., ::-1]
    assert np.abs(coded.astype(int) - image.display).mean() < 8
    with pytest.raises(ArgumentError, match=r"\.png, \.jpg, \.tif or \.exr, found .*a\.bmp"):
        image.save(tmp_path / "a.bmp")


def test_named_dimensions_may_come_in_any_order() -> None:
    import xarray

    given = xarray.DataArray(
        samples().transpose(3, 1, 0, 2),
        dims=("x", "channel", "obs", "y"),
        coords={
            "channel": ["long", "middle", "short"],
            **{f"light_{name}": ("obs", np.array(LIGHTS)[:, i]) for i, name in enumerate("xyz")},
        },
    )
    stack = impasto.Stack(given)
    np.testing.assert_array_equal(stack.samples, samples())
    assert stack.bands == ("long", "middle", "short")
    np.testing.assert_allclose(stack.rig.directions, LIGHTS, rtol=1e-12)
    grey = impasto.Stack(given.isel(channel=0, drop=True), lights=LIGHTS)
    np.testing.assert_array_equal(grey.samples[:, 0], samples()[:, 0])


@pytest.mark.parametrize(
    ("dims", "found"),
    [
        (("obs", "band", "y", "depth"), "'depth' is unknown"),
        (("obs", "channel", "band", "x"), "'band' means the same as 'channel'"),
        (("band", "y", "x"), "found band, y, x"),
    ],
)
def test_dimensions_that_make_no_stack_are_named(dims: tuple[str, ...], found: str) -> None:
    import xarray

    array = xarray.DataArray(np.zeros((2,) * len(dims), np.float32), dims=dims)
    with pytest.raises(ArgumentError, match=found):
        impasto.Stack(array, lights=LIGHTS[:2])


def test_a_stack_without_lights_is_refused() -> None:
    with pytest.raises(ArgumentError, match=r"lights: .*found none"):
        impasto.Stack(samples())


def test_a_dataset_survives_netcdf(tmp_path: Path) -> None:
    import xarray

    small = impasto.Stack(samples(), lights=LIGHTS, pitch_mm=0.5)
    dataset = impasto.fit_sbrdf(small, joint=False).to_xarray()
    dataset.to_netcdf(tmp_path / "fit.nc", engine="h5netcdf")
    with xarray.open_dataset(tmp_path / "fit.nc", engine="h5netcdf") as found:
        xarray.testing.assert_identical(found.load(), dataset)


def test_codes_are_not_linear_light() -> None:
    codes = np.rint(255 * samples()).astype(np.float32)
    with pytest.warns(impasto.ImpastoWarning, match=r"scale=1/255 and saturation=255"):
        impasto.Stack(codes, lights=LIGHTS)
    with pytest.warns(impasto.ImpastoWarning, match="scale=1/65535"):
        impasto.Stack(257 * codes, lights=LIGHTS)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        impasto.Stack(codes, lights=LIGHTS, scale=1 / 255)
        impasto.Stack(samples(), lights=LIGHTS)


def test_an_unknown_illuminant_fails_with_the_scene() -> None:
    with pytest.raises(ArgumentError, match=r"illuminant: .*foo"):
        Scene(LIGHTS, illuminant="foo")
    with pytest.raises(ArgumentError, match="illuminant: "):
        Scene(LIGHTS[:2], illuminant=["A", -5.0])
    with pytest.raises(ArgumentError, match=r"reference: .*foo"):
        Scene(LIGHTS, reference="foo")


def test_messages_show_plain_numbers() -> None:
    with pytest.raises(ArgumentError) as told:
        impasto.fit_sbrdf(
            impasto.Stack(samples(), lights=LIGHTS), index=np.float64(0.5), pooling="painting"
        )
    assert "0.5" in str(told.value)
    assert "np." not in str(told.value)
    with pytest.raises(ArgumentError) as told:
        DistantLight((np.float32(np.nan), np.float64(0.0), np.int64(1)))
    assert "(nan, 0.0, 1)" in str(told.value)
