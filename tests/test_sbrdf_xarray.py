"""Results as xarray datasets: every kind of result, hand-made."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Status

SIZE = (4, 5)
LIGHTS = [(0.0, 0.6, 0.8), (0.6, 0.0, 0.8), (-0.6, 0.0, 0.8)]


def number(*shape: int) -> Any:
    return np.arange(np.prod(shape), dtype=np.float32).reshape(shape)


def shared(bands: int = 3) -> dict[str, Any]:
    status = np.zeros(SIZE, np.uint8)
    status[0, 0] = Status.MASKED
    planes = {name: number(*SIZE) for name in ("residual", "condition", "sigma")}
    normals = impasto.Normals(
        normal=number(3, *SIZE),
        albedo=number(bands, *SIZE),
        used=np.full(SIZE, 3, np.uint16),
        rejected=np.zeros((4, *SIZE), np.uint16),
        status=status,
        method="robust",
        **planes,
    )
    return {
        "normal": number(3, *SIZE),
        "diffuse": number(bands, *SIZE),
        "residual": planes["residual"],
        "sigma": planes["sigma"],
        "status": status,
        "normals": normals,
        "rig": impasto.Rig(LIGHTS, pitch_mm=0.5),
        "bands": tuple(f"band{i}" for i in range(bands)),
    }


def pooled() -> impasto.PooledSbrdf:
    return impasto.PooledSbrdf(
        **shared(),
        beta=1.5,
        gamma=0.1,
        index=1.45,
        covariance=np.eye(2),
        verdict="fitted",
        curve=np.zeros((7, 3)),
        path=np.zeros((2, 2)),
        describes=0.9,
        converged=True,
        misfit=number(*SIZE),
    )


def segmented(*segments: impasto.Segment) -> impasto.SegmentSbrdf:
    return impasto.SegmentSbrdf(
        **shared(),
        beta=number(*SIZE),
        gamma=number(*SIZE),
        misfit=number(*SIZE),
        labels=np.zeros(SIZE, np.int64),
        segments=segments,
        painting=pooled(),
    )


def lobed() -> dict[str, Any]:
    lobes = np.ones(SIZE, np.uint8)
    return {**shared(), "specular": number(2, 3, *SIZE), "lobes": lobes}


def facets() -> impasto.LobeSbrdf:
    gamma = number(2, *SIZE)
    return impasto.LobeSbrdf(
        **lobed(),
        ambient=number(3, *SIZE),
        gamma=gamma,
        gamma_sigma=gamma,
        tinted=gamma > 0.5,
        converged=np.ones(SIZE, dtype=np.bool_),
        index=1.5,
    )


def lafortune() -> impasto.LafortuneSbrdf:
    shape = number(2, *SIZE)
    names = ("cxy", "cz", "exponent", "specular_sigma", "direction_sigma", "exponent_sigma")
    return impasto.LafortuneSbrdf(**lobed(), **dict.fromkeys(names, shape), verdict="fitted")


KINDS = pytest.mark.parametrize("make", [pooled, segmented, facets, lafortune])


@KINDS
def test_every_map_stands_in_the_dataset(make: Any) -> None:
    surface = make()
    dataset = surface.to_xarray()
    maps = {
        name: value
        for name, value in vars(surface).items()
        if isinstance(value, np.ndarray) and value.shape[-2:] == SIZE
    }
    assert {"normal", "diffuse", "residual", "sigma", "status"} < set(maps)
    for name, value in maps.items():
        assert dataset[name].dims[-2:] == ("y", "x"), name
        assert np.shares_memory(dataset[name].values, value), name
    assert dataset["normal"].dims == ("axis", "y", "x")
    assert dataset.attrs["kind"] == f"impasto.{type(surface).__name__}"
    assert list(dataset["band"].values) == ["band0", "band1", "band2"]
    # Pixels of 0.5 mm about the middle of the painting, y up.
    np.testing.assert_allclose(dataset["x"], [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_allclose(dataset["y"], [0.75, 0.25, -0.25, -0.75])
    np.testing.assert_allclose(dataset["light"], LIGHTS)
    words = dataset["status"].attrs["flag_meanings"].split()
    values = dataset["status"].attrs["flag_values"]
    assert words[list(values).index(Status.MASKED)] == "masked"


def test_single_numbers_are_attributes_and_bands_are_picked_by_name() -> None:
    dataset = pooled().to_xarray()
    assert (dataset.attrs["beta"], dataset.attrs["verdict"]) == (1.5, "fitted")
    assert dataset["curve"].shape == (7, 3)
    red = dataset["diffuse"].sel(band="band2")
    np.testing.assert_array_equal(red, pooled().diffuse[2])
    assert facets().to_xarray()["gamma"].attrs == {"units": "rad"}


def test_segments_are_a_table_by_label() -> None:
    covariance = np.array([[0.01, 0.002], [0.002, 0.04]])
    parts = (
        impasto.Segment(3, 400, 2.5, 0.05, covariance, "fitted", own=True),
        impasto.Segment(200, 16, 1.5, 0.1, np.diag([np.inf, np.inf]), "too-few", own=False),
    )
    dataset = segmented(*parts).to_xarray()
    gloss = dataset.sel(segment=3)
    assert (int(gloss["segment_pixels"]), float(gloss["segment_beta"])) == (400, 2.5)
    np.testing.assert_array_equal(gloss["segment_covariance"], covariance)
    assert gloss["segment_covariance"].dims == ("row", "column")
    assert dataset["segment_gamma"].attrs == {"units": "rad"}
    assert dataset["segment_verdict"].values.tolist() == ["fitted", "too-few"]
    assert dataset["segment_own"].values.tolist() == [True, False]
    names = {f"segment_{one.name}" for one in dataclasses.fields(impasto.Segment)}
    assert names - {"segment_label"} <= set(dataset.data_vars)
    assert dataset.attrs["index"] == pooled().index
    assert segmented().to_xarray().sizes["segment"] == 0


def test_a_file_of_netcdf_takes_every_attribute() -> None:
    """Attributes are numbers, texts or arrays: NetCDF knows no truth values and no None."""
    for make in (pooled, segmented, facets, lafortune):
        for value in make().to_xarray().attrs.values():
            assert isinstance(value, str | int | float)
            assert not isinstance(value, bool)


@KINDS
def test_without_xarray_the_extra_is_named(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(impasto.MissingExtraError, match=r"impasto\[scale\]"):
        make().to_xarray()


def test_xarray_is_not_imported_unless_used() -> None:
    code = "import sys, impasto.fit.dataset; print('xarray' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"


@KINDS
def test_some_bands_are_a_surface_again(make: Any, tmp_path: Path) -> None:
    surface = make()
    some = surface.with_bands([2, 0])
    assert some.bands == ("band2", "band0")
    np.testing.assert_array_equal(some.diffuse, surface.diffuse[[2, 0]])
    if isinstance(surface, impasto.LobeSbrdf):
        np.testing.assert_array_equal(some.specular, surface.specular[:, [2, 0]])
        np.testing.assert_array_equal(some.ambient, surface.ambient[[2, 0]])
        assert not some.coated
    assert some.normal is surface.normal
    some.save(tmp_path / "some.npz")
    read = impasto.load_sbrdf(tmp_path / "some.npz")
    assert read.bands == some.bands
    np.testing.assert_array_equal(read.diffuse, some.diffuse)
