"""Stores in half precision: what is rounded, by how much, and what is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

import impasto
from impasto import ArgumentError, ResumeMismatchError
from impasto.io.results.precision import HALF, from_store, to_store
from killed_jobs import stack

LAST = 2.0**-11
"""Half of the last bit of a number in half precision, relative to it."""
LEAST = 2.0**-25
"""The same of numbers below 6e-5, whose last bit is always 2^-24."""
FITS: dict[str, dict[str, Any]] = {
    "matte": {"pooling": "none"},
    "painting": {"pooling": "painting", "effort": "draft"},
    "pixel": {"pooling": "pixel", "effort": "draft", "lobes": 1},
    "lafortune": {"model": "lafortune", "effort": "draft", "lobes": 1},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FITS)
def test_maps_are_rounded_and_all_else_is_the_same(name: str, tmp_path: Path) -> None:
    taken = stack()
    whole = impasto.fit_sbrdf(taken, **FITS[name])
    path = impasto.run(taken, tmp_path / "a.zarr", tile=64, precision="half", **FITS[name])
    assert impasto.jobs.verify(path) == ()
    found = impasto.load_sbrdf(path)
    assert type(found) is type(whole)
    group = zarr.open_group(path, mode="r")
    expected, arrays = whole.arrays(), found.arrays()
    assert expected.keys() == arrays.keys()
    rounded = {key for key in expected if key.rsplit(".", 1)[-1] in HALF and expected[key].ndim > 1}
    assert {"normal", "diffuse", "normals.albedo"} <= rounded
    for key, array in arrays.items():
        assert array.dtype == expected[key].dtype, key
        if key not in rounded:
            assert array.tobytes() == expected[key].tobytes(), key
            continue
        if key in group:
            assert group[key].dtype == np.float16, key
        np.testing.assert_array_equal(np.isnan(array), np.isnan(expected[key]), key)
        if not key.endswith("normal"):
            np.testing.assert_allclose(array, expected[key], LAST, LEAST, err_msg=key)
    known = found.estimated
    exact, half = (one.normal[:, known].astype(np.float64) for one in (whole, found))
    np.testing.assert_allclose(np.linalg.norm(half, axis=0), 1.0, rtol=2e-7)
    # Numbers up to 1 change by 2^-12 at most: three of them turn a normal by 0.0243 degrees.
    chord = np.linalg.norm(np.cross(exact, half, axis=0), axis=0)
    assert chord.max() <= np.sqrt(3.0) * 2.0**-12 + 2e-7


@pytest.fixture(scope="module")
def half(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("half") / "a.zarr"
    return impasto.run(stack(), path, tile=32, precision="half", **FITS["matte"])


def test_parts_and_smaller_scales_are_in_half_precision_too(half: Path, tmp_path: Path) -> None:
    whole, stored = impasto.load_sbrdf(half), impasto.open_sbrdf(half)
    part = stored[5:40, 30:90]
    assert part.normal.tobytes() == whole.normal[:, 5:40, 30:90].tobytes()
    assert stored.map("diffuse", slice(5, 40), slice(30, 90)).dtype == np.float32
    assert zarr.open_array(half / "levels" / "2" / "diffuse", mode="r").dtype == np.float16
    full = impasto.run(stack(), tmp_path / "b.zarr", tile=32, **FITS["matte"])
    scene = impasto.Scene([impasto.DistantLight((0.3, 0.2, 0.9))])
    small, exact = (
        impasto.render(impasto.open_sbrdf(path).level(2), scene).display for path in (half, full)
    )
    # Colours and cosines change by 2^-11 of themselves: by less than a code of 256.
    assert np.abs(small.astype(int) - exact.astype(int)).max() <= 1
    sizes = [sum(one.stat().st_size for one in path.rglob("*/c/**/*")) for path in (half, full)]
    # Counts, codes and notes keep their size.
    assert sizes[0] < 0.8 * sizes[1]


def test_a_job_goes_on_in_its_own_precision(half: Path) -> None:
    with pytest.raises(ResumeMismatchError, match="precision: the job has 'half', this call"):
        impasto.run(stack(), half, tile=32, **FITS["matte"])
    assert impasto.run(stack(), half, tile=32, precision="half", **FITS["matte"]) == half


def test_numbers_beyond_half_precision_are_refused(tmp_path: Path) -> None:
    taken = stack()
    bright = impasto.Stack(taken.samples.astype(np.float32) * 100, lights=taken.rig.directions)
    with pytest.raises(ArgumentError, match=r"precision: diffuse holds .* reaches to 65504"):
        impasto.run(bright, tmp_path / "a.zarr", precision="half", **FITS["matte"])
    with pytest.raises(ArgumentError, match="precision: expected"):
        impasto.run(taken, tmp_path / "a.zarr", precision="double")  # type: ignore[arg-type]


def test_every_number_is_rounded_to_the_nearest_half() -> None:
    """Every half, what lies between two of them, and beside that: as numpy rounds them."""
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    halves = halves[np.isfinite(halves)].astype(np.float32)
    with np.errstate(over="ignore"):
        up = np.nextafter(halves.astype(np.float16), np.float16(np.inf)).astype(np.float32)
    middle = np.where(np.isfinite(up), (halves + up) / 2, halves)
    numbers = np.stack([halves, middle, np.nextafter(middle, np.float32(-np.inf)),
                        np.nextafter(middle, np.float32(np.inf))])  # fmt: skip
    with np.errstate(over="ignore"):
        expected = numbers.astype(np.float16)
    kept = np.isfinite(expected).all(axis=0)
    # Three axes, as maps of several bands have; and a part of them.
    planes = np.ascontiguousarray(numbers[:, kept]).reshape(2, 2, -1)
    found = to_store("diffuse", planes, "half")
    assert found.tobytes() == expected[:, kept].tobytes()
    part = to_store("diffuse", planes[:, :1, 3:77], "half")
    assert part.tobytes() == expected[:, kept].reshape(2, 2, -1)[:, :1, 3:77].tobytes()


def test_what_is_not_finite_stays_as_it_is() -> None:
    plane = np.array([[np.nan, np.inf, -np.inf, 65504.0]], np.float32)
    half = to_store("diffuse", plane, "half")
    assert half.dtype == np.float16
    np.testing.assert_array_equal(from_store("diffuse", half), plane)
    # Names that no map of light, angles or directions has.
    for name in ("exponent", "normals.condition", "levels/2/lobe1.exponent", "relief.height"):
        assert to_store(name, plane, "half") is plane
    assert from_store("residuals.maps", half) is half
