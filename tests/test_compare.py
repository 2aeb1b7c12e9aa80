"""What changed between two states of a painting, against simulations of known changes."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import impasto
from cleaned_painting import CAMERA, LIGHTS, cleaned_painting, fitted, photographed
from command_line import complaint
from impasto import ArgumentError, CorruptInputError, simulate
from impasto.cli import main
from impasto.comparison import Changed, Compared, load_comparison
from impasto.comparison.bounds import inverse_of
from impasto.comparison.significance import critical, tail
from impasto.io import write_png16
from overlapping_frames import Shot, scene

ALPHA = 0.01
PATCH = (slice(14, 36), slice(16, 46))
"""Where the varnish is taken off."""
SIZE = (52, 64)


@dataclass(frozen=True)
class Cleaned:
    """Fits before and after, and before again; the rest is as in :class:`CleanedPainting`."""

    before: impasto.Sbrdf
    after: impasto.Sbrdf
    again: impasto.Sbrdf
    patch: NDArray[np.bool_]
    angle: NDArray[np.float64]
    delta_e: NDArray[np.float64]


@pytest.fixture(scope="module")
def cleaned() -> Cleaned:
    patch = np.zeros(SIZE, np.bool_)
    patch[PATCH] = True
    one = cleaned_painting(SIZE, patch)
    fits = [fitted(*pair) for pair in ((one.before, 1), (one.after, 2), (one.before, 3))]
    return Cleaned(*fits, patch, one.angle, one.delta_e)


@pytest.fixture(scope="module")
def found(cleaned: Cleaned) -> impasto.Comparison:
    return impasto.compare(
        cleaned.before, cleaned.after, align="same", alpha=ALPHA, exposure_sigma=0.0
    )


def maps_of(one: impasto.Comparison) -> Any:
    assert one.maps is not None
    return one.maps


def marked(one: impasto.Comparison, flag: Changed) -> NDArray[np.bool_]:
    return (maps_of(one).changed & flag) > 0


def test_varnish_that_was_taken_off_is_found_where_it_was(
    cleaned: Cleaned, found: impasto.Comparison
) -> None:
    """A yellowed varnish is several dE00 in colour, less in dark paint, and its lobe is gone.

    Outside the probability of a mark is ``ALPHA``. Predicted errors are known to a factor of two
    in the tails: the lobes of a pixel share noise with its colours, which is no normal distribution
    there. So three times ``ALPHA`` is the bound, and a change of all pixels would be a hundred.
    """
    inside, outside = (
        cleaned.patch,
        ~cv2.dilate(cleaned.patch.astype(np.uint8), np.ones((3, 3))).astype(bool),
    )
    assert np.median(cleaned.delta_e[inside]) > 3.0
    assert marked(found, Changed.COLOUR)[inside].mean() > 0.7
    assert marked(found, Changed.GLOSS)[inside].mean() > 0.9
    for flag in Changed:
        assert marked(found, flag)[outside].mean() < 3 * ALPHA, flag
    for area in found.areas[:3]:
        rows, columns = (
            slice(area.top, area.top + area.rows),
            slice(area.left, area.left + area.columns),
        )
        assert cleaned.patch[rows, columns].any(), area


def test_differences_are_the_true_ones(cleaned: Cleaned, found: impasto.Comparison) -> None:
    """A fifth of a percent of noise in 16 photographs is some tenths of a dE00, and of a degree."""
    inside = cleaned.patch
    off = maps_of(found).delta_e[inside] - cleaned.delta_e[inside]
    assert abs(np.median(off)) < 0.5
    assert np.median(np.abs(off)) < 1.0
    angle = np.degrees(maps_of(found).angle - cleaned.angle)
    assert np.median(np.abs(angle)) < 0.6
    # No lobe is left, where the fit found none.
    ratio = maps_of(found).beta_ratio
    assert np.median(ratio[inside]) < 0.1
    # Where neither fit found one there is no ratio: the noise hides the lobe of one pixel in 2700.
    none = (cleaned.before.lobes == 0) & (cleaned.after.lobes == 0)
    np.testing.assert_array_equal(np.isnan(ratio), none)
    assert none[~inside].mean() < 0.001
    assert abs(np.nanmedian(ratio[~inside]) - 1.0) < 0.03


@pytest.mark.parametrize("exposure", ["measured", "matched"])
def test_what_did_not_change_is_marked_as_rarely_as_stated(cleaned: Cleaned, exposure: Any) -> None:
    """A painting photographed twice: chance alone. The bound is that of the test above."""
    one = impasto.compare(
        cleaned.before, cleaned.again, align="same", alpha=ALPHA, exposure_sigma=0.0,
        exposure=exposure,
    )  # fmt: skip
    for row in one.quantities:
        assert row.tested == SIZE[0] * SIZE[1]
        assert row.significant < 3 * ALPHA, row
    # A test that never marks anything would pass so far: normals have the stated rate.
    assert one.quantity("normal").significant > ALPHA / 10
    np.testing.assert_allclose(one.registration.gain, 1.0, atol=0.01)


def test_a_result_compared_with_itself_has_not_changed(cleaned: Cleaned) -> None:
    one = impasto.compare(cleaned.before, cleaned.before, align="same")
    assert [row.significant for row in one.quantities] == [0.0, 0.0, 0.0]
    assert one.compared == {"tested": SIZE[0] * SIZE[1]}
    assert float(np.nanmax(maps_of(one).angle)) < 1e-6
    assert float(np.nanmax(maps_of(one).delta_e)) < 1e-6
    assert "e-" not in str(one)  # rounding is shown as 0


def test_a_global_gain_is_a_change_unless_exposures_are_matched(cleaned: Cleaned) -> None:
    """A fifth more light is 4 dE00 and more in light paint; one gain takes it off."""
    brighter = replace(cleaned.again, diffuse=cleaned.again.diffuse * np.float32(1.2))
    raw = impasto.compare(cleaned.before, brighter, align="same", exposure_sigma=0.0, alpha=ALPHA)
    assert raw.quantity("colour").significant > 0.5
    matched = impasto.compare(
        cleaned.before, brighter, align="same", exposure="matched", exposure_sigma=0.0, alpha=ALPHA
    )
    assert matched.quantity("colour").significant < 3 * ALPHA
    # Gains come from thousands of pixels, each known to a percent or so.
    np.testing.assert_allclose(matched.registration.gain, 1.0 / 1.2, rtol=0.01)


def test_statuses_say_what_could_not_be_compared(cleaned: Cleaned) -> None:
    first, second = np.ones(SIZE, np.bool_), np.ones(SIZE, np.bool_)
    first[:4], second[:, :5] = False, False
    before, after = (
        impasto.fit_sbrdf(replaced(cleaned.before, mask), pooling="painting")
        for mask in (first, second)
    )
    one = impasto.compare(before, after, align="same")
    status = maps_of(one).status
    assert (status[:4, :5] == Compared.UNKNOWN_BOTH).all()
    assert (status[:4, 5:] == Compared.UNKNOWN_BEFORE).all()
    assert (status[4:, :5] == Compared.UNKNOWN_AFTER).all()
    assert (status[4:, 5:] == Compared.TESTED).all()
    assert np.isnan(maps_of(one).angle[status >= 16]).all()
    assert not maps_of(one).changed[status >= 16].any()
    assert sum(one.compared.values()) == status.size


def replaced(fit: impasto.Sbrdf, mask: NDArray[np.bool_]) -> impasto.Stack:
    """Photographs that the model shows, under a mask."""
    shown = np.nan_to_num(fit.predict(LIGHTS, fidelity="model"))
    return impasto.Stack(shown, lights=LIGHTS, bands=CAMERA.bands, mask=mask)


SHOTS = (
    Shot(70.0, 56.0),
    Shot(70.37, 55.71),
    Shot(69.1, 56.2, angle=0.2, scale=0.85, tilt=(0.01, -0.02, 0.0)),
)


@pytest.fixture(scope="module")
def shots() -> list[impasto.Sbrdf]:
    """One painting, photographed from three places."""
    taken = scene((112, 140), (88, 96), SHOTS, lights=9, fine=2)
    return [impasto.fit_sbrdf(stack, pooling="painting") for stack in taken.stacks]


@pytest.mark.parametrize("number", [1, 2])
def test_shifts_scales_and_rotations_are_recovered(shots: list[impasto.Sbrdf], number: int) -> None:
    """To a twentieth of a pixel everywhere, as patches agree to some hundredths of one."""
    one = impasto.compare(shots[0], shots[number])
    shot, place = SHOTS[number], one.registration
    height, width = shots[0].shape
    x, y = np.meshgrid([0.0, width - 1.0], [0.0, height - 1.0])
    found = np.einsum("ij,jyx->iyx", place.linear, [x, y]) + np.reshape(place.offset, (2, 1, 1))
    # Where the simulation has these pixels, relative to the first shot.
    right, down = x - (width - 1) / 2, y - (height - 1) / 2
    cos, sin = np.cos(shot.angle), np.sin(shot.angle)
    true = np.array(
        [
            shot.x + shot.scale * (cos * right + sin * down) - SHOTS[0].x + (width - 1) / 2,
            shot.y + shot.scale * (-sin * right + cos * down) - SHOTS[0].y + (height - 1) / 2,
        ]
    )
    assert float(np.abs(found - true).max()) < 0.05
    assert np.degrees(place.tilt) == pytest.approx(np.degrees(np.linalg.norm(shot.tilt)), abs=0.15)
    assert place.sigma < 0.05
    # Interpolation adds errors of its own, which predicted ones only estimate (docs/compare.md).
    assert one.quantity("normal").significant < 0.02
    assert one.quantity("colour").significant < 0.04
    assert one.compared["tested"] + one.compared.get("outside", 0) == height * width


def test_a_crop_is_placed_and_the_rest_is_outside(shots: list[impasto.Sbrdf]) -> None:
    part = shots[0][10:70, 12:90]
    one = impasto.compare(shots[0], part)
    assert one.registration.offset == pytest.approx((12.0, 10.0), abs=0.02)
    status = maps_of(one).status
    inside = np.zeros(status.shape, np.bool_)
    inside[10:70, 12:90] = True
    assert (status[~inside] == Compared.OUTSIDE).all()
    assert (status[inside] == Compared.TESTED).all()
    assert one.quantity("normal").significant == 0.0
    back = impasto.compare(part, shots[0])
    assert back.compared == {"tested": 60 * 78}


def test_maps_do_not_depend_on_tiles(
    shots: list[impasto.Sbrdf], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor on whether the two are stores; a store has the same maps as the memory."""
    one, other = shots[0][:56, :64], shots[1][:56, :64]
    one.save(tmp_path / "a.zarr")
    other.save(tmp_path / "b.zarr")
    whole = impasto.compare(one, other, cells=4)
    monkeypatch.setattr("impasto.comparison.comparing.TILE", 32)
    monkeypatch.setattr("impasto.comparison.comparing.STORED_TILE", 32)
    stored = impasto.compare(tmp_path / "a.zarr", tmp_path / "b.zarr", tmp_path / "c.zarr", cells=4)
    assert stored.maps is None
    read = load_comparison(tmp_path / "c.zarr")
    for name, plane in maps_of(whole).arrays().items():
        other = maps_of(read).arrays()[name]
        if plane.dtype == np.uint8:
            # A value at its threshold may fall on either side with the order of sums.
            assert (plane != other).mean() < 1e-3, name
        else:
            np.testing.assert_allclose(other, plane, rtol=1e-4, atol=1e-5, err_msg=name)
    assert [area.name for area in read.areas] == [area.name for area in stored.areas]
    assert read.to_dict() == stored.to_dict()
    assert str(read) == str(stored)
    with pytest.raises(ArgumentError, match="exists"):
        impasto.compare(one, other, tmp_path / "c.zarr")


def test_progress_is_told_within_tiles(
    shots: list[impasto.Sbrdf], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("impasto.comparison.comparing.TILE", 32)
    seen: list[tuple[int, int]] = []
    part = shots[0][:56, :64]
    impasto.compare(part, part, progress=lambda done, total: seen.append((done, total)))
    # Four tiles.
    assert seen == [(done, 12) for done in range(1, 13)]


def test_inverses_are_those_of_lapack() -> None:
    """Of products of columns as pixels have them, some nearly the same as others.

    Either inverse has a relative error of the condition number, a million at most, times a few
    roundings of 1.1e-16.
    """
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(500, 16, 6))
    columns[:250, :, 5] = columns[:250, :, 4] + rng.uniform(1e-2, 1e-1, (250, 1))
    products = columns.swapaxes(1, 2) @ columns + 1e-6 * np.eye(6)
    assert np.linalg.cond(products).max() < 1e6
    found = inverse_of(np.moveaxis(products, 0, -1))
    expected = np.moveaxis(np.linalg.inv(products), 0, -1)
    largest = np.abs(expected).max(axis=(0, 1))
    assert (np.abs(found - expected).max(axis=(0, 1)) / largest).max() < 1e-9


def test_a_comparison_survives_its_file(found: impasto.Comparison, tmp_path: Path) -> None:
    found.save(tmp_path / "c.npz")
    read = load_comparison(tmp_path / "c.npz")
    assert read.to_dict() == found.to_dict()
    assert str(read) == str(found)
    np.testing.assert_array_equal(maps_of(read).changed, maps_of(found).changed)
    np.testing.assert_array_equal(read.picture(), found.picture())
    data = bytearray((tmp_path / "c.npz").read_bytes())
    data[len(data) // 2] ^= 0xFF
    (tmp_path / "d.npz").write_bytes(data)
    with pytest.raises(CorruptInputError):
        load_comparison(tmp_path / "d.npz")


def test_fits_of_two_kinds_are_cautioned_against(cleaned: Cleaned, tmp_path: Path) -> None:
    # The same photographs, fitted twice: nothing changed but the fit.
    one = cleaned_painting(SIZE, cleaned.patch)
    pooled = impasto.fit_sbrdf(photographed(one.before, 1), pooling="painting")
    found = impasto.compare(pooled, cleaned.before, align="same")
    assert found.fits == ("one lobe for the painting", "lobes per pixel")
    caution = "fitted in two ways, one lobe for the painting before and lobes per pixel after"
    assert f"caution: {caution}" in str(found)
    assert str(found.rows()["caution"]).startswith(caution)
    assert "gloss is tested where both fits have lobes of pixels or segments" in str(found)
    found.save(tmp_path / "c.npz")
    assert str(load_comparison(tmp_path / "c.npz")) == str(found)
    alike = impasto.compare(cleaned.before, cleaned.again, align="same")
    assert "caution" not in str(alike)
    assert "caution" not in alike.rows()
    assert "gloss is tested" not in str(alike)


def test_bands_without_colours_leave_normals_and_gloss(cleaned: Cleaned) -> None:
    """Three bands before and two after: no colour; with one band each, greys are compared."""
    one = impasto.compare(cleaned.before, cleaned.after.with_bands([0, 1]), align="same")
    assert one.illuminant.startswith("not compared: 2 bands")
    assert one.quantity("colour").tested == 0
    assert np.isnan(maps_of(one).delta_e).all()
    assert one.quantity("normal").tested == SIZE[0] * SIZE[1]
    grey = impasto.compare(
        cleaned.before.with_bands([1]), cleaned.after.with_bands([1]), align="same"
    )
    assert marked(grey, Changed.COLOUR)[cleaned.patch].mean() > 0.5


def test_six_bands_and_three_have_colours_through_their_cameras() -> None:
    """The same paint by two cameras: Wiener estimates differ by one or two dE00, not by ten.

    Without cameras the six bands have no colour at all.
    """
    painting = simulate.painting(5, (28, 32), varnish=None)
    fits = []
    cameras = simulate.camera("rgb"), simulate.camera("six-band")
    for camera in cameras:
        surface = impasto.Surface(painting.normal, painting.reflectance_in(camera))
        stack = impasto.Stack(surface.predict(LIGHTS), lights=LIGHTS, bands=camera.bands)
        fits.append(impasto.fit_sbrdf(stack, pooling="painting"))
    one = impasto.compare(fits[0], fits[1], align="same", camera=cameras, illuminant="A")
    assert one.illuminant == "under A"
    assert one.quantity("colour").median < 2.5
    spectra = (
        impasto.fit_reflectance(None, fits[0], cameras[0], estimator="wiener"),
        impasto.fit_reflectance(None, fits[1], cameras[1], estimator="wiener"),
    )
    two = impasto.compare(fits[0], fits[1], align="same", reflectance=spectra, illuminant="A")
    assert two.quantity("colour").median < 2.5
    with pytest.raises(ArgumentError, match="reflectance: expected a pair"):
        impasto.compare(fits[0], fits[1], align="same", reflectance=spectra[0])
    bare = impasto.compare(fits[0], fits[1], align="same")
    assert bare.illuminant.startswith("not compared: 6 bands")
    with pytest.raises(ArgumentError, match=r"illuminant: A needs spectra"):
        impasto.compare(fits[0], fits[0], align="same", illuminant="A")


def test_heights_that_changed_are_found(shots: list[impasto.Sbrdf]) -> None:
    """A paraboloid that is added is a slope; its height comes back up to a constant."""
    before = shots[0]
    rows, columns = before.shape
    y, x = np.mgrid[:rows, :columns] - np.array([(rows - 1) / 2, (columns - 1) / 2]).reshape(
        2, 1, 1
    )
    bump = 3.0 * np.exp(-(x * x + y * y) / (2 * 12.0**2))
    down, across = np.gradient(bump)
    slopes = before.normal.astype(np.float64) / before.normal[2]
    normal = np.stack([slopes[0] - across, slopes[1] + down, np.ones_like(bump)])
    after = replace(before, normal=(normal / np.linalg.norm(normal, axis=0)).astype(np.float32))
    one = impasto.compare(before, after, align="same", height=True)
    found = maps_of(one).height
    assert found is not None
    off = found - bump
    # The bump is 3 pixels high; differences of slopes at pixel edges are off by a few hundredths.
    assert float(np.abs(off - np.median(off)).max()) < 0.15


@pytest.mark.parametrize(("rank", "freedom"), [(1, 3), (2, 7), (3, 5), (3, 60), (1, 400), (2, 33)])
def test_quantiles_are_those_of_scipy(rank: int, freedom: int) -> None:
    """T squared over its rank is Fisher's F with these degrees of freedom."""
    for alpha in (0.05, 0.001):
        expected = rank * stats.f.isf(alpha, rank, freedom)
        assert critical(alpha, rank, freedom) == pytest.approx(expected, rel=1e-9)
    assert tail(2.3 * rank, rank, freedom) == pytest.approx(
        stats.f.sf(2.3, rank, freedom), rel=1e-9
    )


def test_the_command_writes_a_picture_maps_and_a_report(
    cleaned: Cleaned, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cleaned.before.save(tmp_path / "before.npz")
    cleaned.after.save(tmp_path / "after.npz")
    regions = np.zeros(SIZE, np.uint8)
    regions[PATCH], regions[:10, :10] = 2, 1
    cv2.imwrite(str(tmp_path / "regions.png"), regions)
    names = [str(tmp_path / name) for name in ("before.npz", "after.npz")]
    out = tmp_path / "out"
    words = ["--out", str(out), "--align", "same", "--regions", str(tmp_path / "regions.png")]
    assert main(["compare", *names, *words, "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [area["name"] for area in told["areas"]] == ["2", "1"]
    assert told["areas"][0]["changed"][1] > 0.9
    # Nearly all of its lobes are gone, each counts as a tenth; a few are weak ones of noise.
    assert 0.099 < told["areas"][0]["gloss"] < 0.15
    assert told["areas"][1]["gloss"] == pytest.approx(1.0, abs=0.05)
    box = [told["areas"][0][name] for name in ("top", "left", "rows", "columns")]
    assert box == [14, 16, 22, 30]
    report = json.loads((out / "report.json").read_text())
    assert report["results"] == told
    assert {entry["file"] for entry in report["outputs"]} == {"comparison.npz", "comparison.png"}
    picture = cv2.imread(str(out / "comparison.png"))
    assert picture.shape[1] > 1200
    # An earlier comparison is replaced, as every result is.
    assert main(["compare", *names, *words]) == 0
    told = capsys.readouterr()
    assert "gloss, ratio of beta" in told.out
    assert told.err.splitlines()[-1] == f"Look at {out / 'comparison.png'}"
    assert main(["compare", *names, "--align", "same", "--quiet"]) == 0
    assert "gloss, ratio of beta" in capsys.readouterr().out


def test_photographs_are_fitted_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A result before, and a folder of 16-bit photographs with a light file after."""
    painting = simulate.painting(2, (10, 12), varnish=None)
    surface = impasto.Surface(painting.normal, painting.reflectance_in(CAMERA))
    lights = LIGHTS[:9]
    samples = surface.predict(lights)
    stack = impasto.Stack(0.8 * samples, lights=lights, bands=CAMERA.bands)
    impasto.fit_sbrdf(stack, pooling="painting").save(tmp_path / "before.npz")
    folder = tmp_path / "after"
    folder.mkdir()
    lines = [f"{len(lights)}"]
    for number, shown in enumerate(samples):
        codes = np.rint(65535 * np.clip(0.6 * shown, 0.0, 1.0)).astype(np.uint16)
        cv2.imwrite(str(folder / f"{number}.png"), np.moveaxis(codes, 0, -1)[..., ::-1])
        lines.append(f"{number}.png " + " ".join(f"{x:.6f}" for x in lights[number]))
    (folder / "lights.lp").write_text("\n".join(lines) + "\n")
    names = [str(tmp_path / "before.npz"), str(folder)]
    assert main(["compare", *names, "--align", "same", "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    rows = {row["name"]: row for row in told["quantities"]}
    # A quarter less light: darker everywhere, with the same relief (degrees).
    assert rows["colour"]["significant"] > 0.9
    assert rows["normal"]["median"] < 0.05


def test_a_folder_of_something_else_is_refused_before_anything_is_fitted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letter.txt").write_text("dear")
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    (photographs / "lights.lp").write_text("0\n")
    monkeypatch.setattr(impasto, "read_stack", lambda *_: pytest.fail("photographs were read"))
    assert main(["compare", *[str(photographs)] * 2, "--out", str(tmp_path / "out")]) == 1
    assert "files of other programs" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"before": 3}, r"before: expected a result .*found int"),
        ({"align": "some"}, r"align: expected 'found' or 'same'"),
        ({"alpha": 0.0}, r"alpha: expected a probability"),
        ({"alpha": np.nan}, r"alpha: expected a probability"),
        ({"exposure_sigma": -1.0}, r"exposure_sigma: expected a share"),
        ({"cells": 0}, r"cells: expected a whole number"),
        ({"regions": np.zeros((2, 2), int)}, r"regions: expected whole numbers \(52, 64\)"),
        ({"camera": "rgb"}, r"camera: expected an impasto.Camera"),
        ({"out": "x.npz"}, r"out: expected a name ending in .zarr"),
        ({"out": "x\0.zarr"}, r"out: .* is no name of a file"),
        ({"out": "none/x.zarr"}, r"out: the folder .* does not exist"),
    ],
)
def test_wrong_calls_are_refused_by_name(
    cleaned: Cleaned, change: dict[str, Any], message: str
) -> None:
    given = {"before": cleaned.before, "after": cleaned.after, "align": "same"} | change
    with pytest.raises(ArgumentError, match=message):
        impasto.compare(**given)


def test_paintings_that_do_not_fit_are_refused(
    cleaned: Cleaned,
    shots: list[impasto.Sbrdf],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(ArgumentError, match=r"align: .same. needs the same pixels"):
        impasto.compare(cleaned.before, shots[0], align="same")
    with pytest.raises(ArgumentError, match=r"after: after cannot be placed on before"):
        impasto.compare(cleaned.before, shots[0])
    (tmp_path / "text.npz").write_text("no result")
    cleaned.before.save(tmp_path / "a.npz")
    one, wrong, gone = (str(tmp_path / name) for name in ("a.npz", "text.npz", "gone"))
    assert "text.npz" in complaint(["compare", one, wrong, "--quiet"], 3, capsys)
    assert "does not exist" in complaint(["compare", one, gone, "--quiet"], 1, capsys)
    dark = tmp_path / "dark"
    dark.mkdir()
    write_png16(dark / "1.png", np.zeros((8, 8, 3), np.uint16))
    said = complaint(["compare", one, str(dark), "--quiet"], 1, capsys)
    assert "no light file" in said
    assert "fit it by impasto fit" in said
