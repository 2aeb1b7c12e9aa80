"""Photographs in dask arrays: lazy maps, each tile fitted once, bit for bit those of the whole."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import dask.array as da
import numpy as np
import pytest
import xarray

import impasto
from impasto import ArgumentError, GeometryError, LazyStack
from impasto.fit import lazy as lazy_module
from impasto.fit.lobes import HALO
from killed_jobs import stack
from processes import surroundings

CHUNKS = (5, 2, 33, 40)
"""Nine tiles, cut off by the border, and chunks along photographs and bands."""
SHARED = 66
"""Rows and columns of the chunks of maps: two and one of the tiles down, one and two across."""
LOBES: dict[str, Any] = {"pooling": "pixel", "effort": "draft", "lobes": 1}


@pytest.fixture(autouse=True)
def small_chunks_of_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """That there are several in a small painting, with one tile and with more."""
    monkeypatch.setattr(lazy_module, "CHUNK", SHARED)


def lazy(samples: Any = None, **options: Any) -> LazyStack:
    taken = stack()
    samples = da.from_array(taken.samples, chunks=CHUNKS) if samples is None else samples
    about = {"lights": taken.rig, "scale": taken.scale, "saturation": taken.saturation}
    return LazyStack(samples, **{**about, **options})


def same(lazily: Any, whole: Any, names: set[str]) -> None:
    """Every map, bit for bit; ``lazily`` is computed here, by two threads."""
    assert all(hasattr(lazily[name].data, "dask") for name in names), "a map is not lazy"
    found = lazily.compute(scheduler="threads", num_workers=2)
    for name in names:
        values = np.asarray(getattr(whole, name))
        assert found[name].dtype == values.dtype, name
        assert found[name].shape == values.shape, name
        assert found[name].values.tobytes() == values.tobytes(), name


@pytest.mark.parametrize(
    "options",
    [{"pooling": "none"}, {"pooling": "painting", "effort": "draft"}, LOBES],
    ids=lambda options: options["pooling"],
)
def test_lazy_maps_are_those_of_the_whole(options: dict[str, Any]) -> None:
    whole = impasto.fit_sbrdf(stack(), **options)
    dataset = impasto.fit_sbrdf(lazy(), **options)
    expected = whole.to_xarray()
    names = {"normal", "diffuse", "residual", "sigma", "status"}
    names |= {"specular", "gamma", "lobes"} if "lobes" in options else {"misfit"}
    same(dataset, whole, names)
    assert set(dataset.variables) == set(expected.variables)
    assert dataset["status"].attrs.keys() == expected["status"].attrs.keys()
    assert dataset.attrs["kind"] == expected.attrs["kind"]
    assert dataset.attrs.get("beta") == expected.attrs.get("beta")


@pytest.mark.slow
def test_tiles_have_the_border_that_a_fit_needs() -> None:
    """Searches that start from neighbours, with a mask; chunks thinner than the border grow."""
    mask = np.ones((70, 90), bool)
    mask[20:45, 30:60] = False
    options = {**LOBES, "effort": impasto.Effort(start="neighbours")}
    assert impasto.learn_sbrdf(stack(), **options).halo == HALO
    whole = impasto.fit_sbrdf(stack()._replace(mask=mask), **options)
    chunks = (12, 3, (33, 35, 2), (40, 48, 2))
    samples = da.from_array(stack().samples, chunks=chunks)
    dataset = impasto.fit_sbrdf(lazy(samples, mask=mask), **options)
    same(dataset, whole, {"normal", "specular", "gamma", "status"})


@pytest.mark.parametrize("method", ["robust", "least-squares"])
def test_lazy_normals_are_those_of_the_whole(method: Any) -> None:
    dataset = impasto.fit_normals(lazy(), method=method)
    whole = impasto.fit_normals(stack(), method=method)
    same(dataset, whole, {"normal", "albedo", "used", "rejected", "sigma", "status"})
    assert dataset.attrs["method"] == method


def counted() -> tuple[Any, list[tuple[int, int]]]:
    """Samples that take down which chunks of them are read."""
    read: list[tuple[int, int]] = []
    samples = stack().samples

    def block(block_info: Any = None) -> Any:
        place = [slice(*at) for at in block_info[None]["array-location"]]
        read.append((place[2].start, place[3].start))
        return samples[tuple(place)]

    chunks = ((12,), (3,), (33, 33, 4), (40, 40, 10))
    meta = np.empty((0,) * 4, samples.dtype)
    return da.map_blocks(block, chunks=chunks, dtype=samples.dtype, meta=meta), read


def test_nothing_is_computed_before_it_is_asked_for_and_all_maps_once() -> None:
    model = impasto.learn_sbrdf(stack(), pooling="painting", effort="draft")
    samples, read = counted()
    dataset = model.apply(lazy(samples))
    assert read == []
    corner = dataset["normal"][:, :20, :20].compute(scheduler="synchronous")
    # The tiles that share a chunk of the maps, and no others.
    assert sorted(read) == [(0, 0), (33, 0)]
    assert np.isfinite(corner.values).any()
    read.clear()
    dataset.compute(scheduler="synchronous")
    assert sorted(read) == [(y, x) for y in (0, 33, 66) for x in (0, 40, 80)]


def test_small_tiles_share_the_chunks_of_maps() -> None:
    """Tasks beyond the fits are those of chunks; large tiles are chunks as they are."""
    model = impasto.learn_sbrdf(stack(), pooling="painting", effort="draft")
    dataset = model.apply(lazy())
    assert dataset["normal"].chunks == ((3,), (66, 4), (40, 50))
    maps = sum(dataset[name].chunks is not None for name in dataset.variables)
    # Nine tiles of samples, fits, four chunks of their results and of every map, and the model.
    samples = sum(len(layer) for layer in lazy()._samples.dask.layers.values())
    assert len(dict(dataset.__dask_graph__())) <= samples + 9 + 4 + 4 * maps + 1


def test_a_model_of_some_pixels_is_that_of_a_job(tmp_path: Any) -> None:
    """Every third row and column, as :func:`impasto.run` takes them."""
    pytest.importorskip("fcntl", reason="jobs need POSIX")
    out = impasto.run(stack(), tmp_path / "a.zarr", tile=64, sample=3, pooling="painting")
    dataset = impasto.fit_sbrdf(lazy(sample=3), pooling="painting")
    same(dataset, impasto.load_sbrdf(out), {"normal", "diffuse", "misfit", "status"})


def test_a_labelled_array_brings_its_own_lights() -> None:
    """Dimensions in any order, bands and lights by name; near lamps keep their places in tiles."""
    taken = stack()
    directions = taken.rig.directions
    labelled = xarray.DataArray(
        da.from_array(np.moveaxis(taken.samples, 0, -1), chunks=(3, 33, 40, 6)),
        dims=("band", "y", "x", "light"),
        coords={"band": ["r", "g", "b"]}
        | {f"light_{axis}": ("light", directions[:, i]) for i, axis in enumerate("xyz")},
    )
    about = {"scale": taken.scale, "saturation": taken.saturation, "pitch_mm": 0.5}
    dataset = impasto.fit_sbrdf(LazyStack(labelled, **about), pooling="none")
    expected = impasto.Stack(labelled.compute(), **about)
    assert dataset["band"].values.tolist() == ["r", "g", "b"]
    same(dataset, impasto.fit_sbrdf(expected, pooling="none"), {"normal", "status"})
    np.testing.assert_array_equal(dataset["x"], (np.arange(90) - 44.5) * 0.5)
    lamps = [impasto.PointLight(tuple(60.0 * direction)) for direction in directions]
    near: dict[str, Any] = {**about, "lights": lamps}
    whole = impasto.fit_normals(impasto.Stack(taken.samples, **near))
    samples = da.from_array(taken.samples, chunks=CHUNKS)
    same(impasto.fit_normals(LazyStack(samples, **near)), whole, {"normal", "sigma"})


def test_a_mask_may_name_its_dimensions_in_any_order() -> None:
    """On a square picture nothing else tells rows from columns."""
    taken = stack((40, 40))
    mask = np.zeros((40, 40), bool)
    mask[:10] = True
    turned = xarray.DataArray(mask.T, dims=("x", "y"))
    rig, scale = taken.rig, taken.scale
    found = impasto.Stack(taken.samples, lights=rig, scale=scale, mask=turned)
    assert found.mask is not None
    np.testing.assert_array_equal(found.mask, mask)
    samples = da.from_array(taken.samples, chunks=(*taken.shape[:2], 20, 20))
    lazily = LazyStack(samples, lights=rig, scale=scale, mask=turned)
    status = impasto.fit_normals(lazily)["status"].values
    np.testing.assert_array_equal(status != impasto.Status.MASKED, mask)
    with pytest.raises(ArgumentError, match="mask: the dimension 'time' is unknown; rename it to"):
        impasto.Stack(taken.samples, lights=rig, mask=xarray.DataArray(mask, dims=("y", "time")))


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "numpy": (lambda: LazyStack(stack().samples, lights=stack().rig), "expected a dask array"),
    "dimensions": (lambda: lazy(da.zeros((3, 4))), r"expected \(obs, band, y, x\)"),
    "lights": (lambda: lazy(lights=stack().rig.take([0, 1])), "12 observations need 12 lights"),
    "mask": (lambda: lazy(mask=np.ones((3, 4))), r"mask: expected shape \(70, 90\)"),
    "sample": (lambda: lazy(sample=2), "sample: expected an odd number"),
    "unknown": (
        lambda: lazy(da.from_array(stack().samples)[..., da.ones(90) > 0]),
        "chunks of unknown size",
    ),
    "segments": (
        lambda: impasto.fit_sbrdf(lazy(), segments=np.zeros((70, 90), int)),
        "without segments",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_lazy_is_refused(case: str) -> None:
    call, words = REFUSED[case]
    with pytest.raises(ArgumentError, match=words):
        call()


def test_a_model_of_another_painting_is_refused() -> None:
    model = impasto.learn_sbrdf(stack()[:60], pooling="none")
    with pytest.raises(GeometryError, match="has 70 x 90 pixels, the model is one of 60 x 90"):
        model.apply(lazy())


def test_dask_is_imported_by_lazy_stacks_alone() -> None:
    program = (
        "import sys, numpy as np, impasto\n"
        "stack = impasto.Stack(np.full((4, 3, 8, 8), 0.5, np.float32), "
        "lights=[(0.5, 0, 0.9), (0, 0.5, 0.9), (-0.5, 0, 0.9), (0, 0, 1)])\n"
        "impasto.fit_sbrdf(stack, pooling='none')\n"
        "print([m for m in ('dask', 'distributed', 'xarray') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=surroundings(), capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == "[]"


def test_a_lazy_stack_without_dask_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "dask.array", None)
    with pytest.raises(impasto.MissingExtraError, match=r"impasto\[scale\]"):
        LazyStack(None)
