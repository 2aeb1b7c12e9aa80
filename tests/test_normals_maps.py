"""Some of the maps of ``fit_normals``, and memory that maps are written to again.

The oracle is the complete fit into new memory, whose numbers other tests hold to independent ones:
what is asked for must not change a bit of a map, so there are no tolerances.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Status
from impasto.fit.partial_normals import NORMAL_MAPS

SIZE = (37, 71)
"""More than a block of 512 pixels; no register ends with a row."""


WHITE = {"uint8": 255, "uint16": 65_535, "float16": 1.0, "float32": 1.0}
"""Where samples of a type are clipped."""


def photographs(bands: int = 3, dtype: Any = np.uint16) -> np.ndarray:
    """Eight photographs with a highlight, a shadow, a black and a clipped patch."""
    rng = np.random.default_rng(3)
    samples = rng.integers(8_000, 50_000, (8, bands, *SIZE))
    samples[2, :, 3:9, 5:40] = 64_000
    samples[:, :, 20, 10:50] = 0
    samples[1:, :, 22, 3] = 65_535
    samples[5, 0, 30:, ::7] = 65_535
    scaled = samples * (WHITE[np.dtype(dtype).name] / 65_535)
    return scaled.astype(dtype)


def stack(bands: int = 3, dtype: Any = np.uint16, near: bool = False) -> impasto.Stack:
    angle = np.arange(8) * 2.4
    lights = np.stack([0.6 * np.cos(angle), 0.5 * np.sin(angle), np.full(8, 0.8)], axis=1)
    mask = np.ones(SIZE, bool)
    mask[30, 40:44] = False
    return impasto.Stack(
        photographs(bands, dtype),
        lights=[impasto.PointLight(tuple(400.0 * light)) for light in lights] if near else lights,
        pitch_mm=0.5 if near else None,
        saturation=WHITE[np.dtype(dtype).name],
        mask=mask,
    )


def same(found: Any, expected: Any, name: str) -> None:
    assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name


CASES = {
    "least-squares": {"method": "least-squares"},
    "one band": {"method": "least-squares", "selection": 0},
    "threshold": {"method": "threshold"},
    "rank": {"method": "rank"},
    "huber": {"method": "huber"},
    "robust": {},
}


@pytest.mark.parametrize("options", CASES.values(), ids=CASES)
@pytest.mark.parametrize("bands", [1, 2, 3, 4])
def test_a_map_alone_has_the_bits_of_the_complete_fit(bands: int, options: Any) -> None:
    given = stack(bands)
    complete = impasto.fit_normals(given, threads=1, **options)
    assert {Status.FITTED, Status.DARK, Status.SATURATED, Status.MASKED} <= set(
        complete.status.ravel()
    )
    for names in [*((name,) for name in NORMAL_MAPS), ("sigma", "normal"), NORMAL_MAPS]:
        some = impasto.fit_normals(given, threads=1, maps=names, **options)
        same(some, complete, "status")
        for name in NORMAL_MAPS:
            if name in names:
                same(some, complete, name)
            else:
                assert getattr(some, name) is None


@pytest.mark.parametrize("near", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.float16, np.float32])
def test_every_type_of_samples_and_light(dtype: Any, near: bool) -> None:
    given = stack(dtype=dtype, near=near)
    complete = impasto.fit_normals(given, method="least-squares", threads=2)
    some = impasto.fit_normals(given, method="least-squares", maps=["normal"], threads=1)
    same(some, complete, "normal")
    same(some, complete, "status")


def test_neighbours_change_no_bit_of_a_pixel_that_is_whole() -> None:
    """Registers with a clipped, a black or a missing sample go another way than plain ones."""
    samples = np.clip(photographs(dtype=np.float32), 0.12, 0.9)
    lights = stack().rig
    plain = impasto.fit_normals(impasto.Stack(samples, lights=lights), method="least-squares")
    for awkward in (np.inf, np.nan, 1e25, 0.0):
        changed = samples.copy()
        changed[:, :, ::2, ::3] = awkward
        found = impasto.fit_normals(impasto.Stack(changed, lights=lights), method="least-squares")
        untouched = np.ones(SIZE, bool)
        untouched[::2, ::3] = False
        assert (found.status[~untouched] != Status.FITTED).all()
        for name in (*NORMAL_MAPS, "status"):
            now, before = getattr(found, name), getattr(plain, name)
            assert now[..., untouched].tobytes() == before[..., untouched].tobytes(), name


def test_samples_whose_squares_leave_single_precision_are_no_fit_without_residuals_either() -> None:
    """Residuals of 1e20 have squares of 1e40: the status must not depend on who asks for them."""
    samples = photographs(1, np.float32) * np.float32(1e20)
    given = impasto.Stack(samples, lights=stack().rig)
    complete = impasto.fit_normals(given, method="least-squares")
    assert (complete.status == Status.INVALID_INPUT).any()
    same(impasto.fit_normals(given, method="least-squares", maps=("normal",)), complete, "status")


@pytest.mark.parametrize("options", [{"method": "least-squares"}, {}], ids=["squares", "robust"])
def test_memory_is_written_again(options: Any) -> None:
    given, other = stack(), stack()
    turned = impasto.Stack(other.samples[::-1].copy(), lights=other.rig, mask=other.mask)
    expected = impasto.fit_normals(given, **options)
    used = impasto.fit_normals(turned, **options)
    assert used.normal.tobytes() != expected.normal.tobytes()
    again = impasto.fit_normals(given, out=used, **options)
    assert isinstance(again, impasto.Normals)
    for name in (*NORMAL_MAPS, "status"):
        assert getattr(again, name) is getattr(used, name)
        same(again, expected, name)


def test_memory_of_some_maps_is_written_again() -> None:
    some = impasto.fit_normals(stack(), maps=("normal", "rejected"))
    expected = impasto.fit_normals(stack(), method="rank")
    again = impasto.fit_normals(stack(), method="rank", out=some)
    assert isinstance(again, impasto.PartialNormals)
    assert again.method == "rank"
    assert again.normal is some.normal
    same(again, expected, "normal")
    same(again, expected, "rejected")
    assert repr(again) == "<PartialNormals 71 x 37 pixels, rank: normal, rejected>"


def test_a_fit_needs_all_maps() -> None:
    some = impasto.fit_normals(stack(), maps=("normal",))
    words = r"needs all maps .*: normal>; call impasto\.fit_normals without maps="
    with pytest.raises(impasto.ArgumentError, match=words):
        impasto.fit_sbrdf(stack(), normals=some)  # type: ignore[call-overload]


def test_some_maps_are_cropped_and_rotated() -> None:
    some = impasto.fit_normals(stack(), maps=("normal", "sigma"))
    complete = impasto.fit_normals(stack())
    same(some[2:9, 4:60], complete[2:9, 4:60], "normal")
    same(some.rotated(), complete.rotated(), "normal")
    same(some.rotated(), complete.rotated(), "sigma")
    assert some.rotated().albedo is None


@pytest.mark.parametrize(
    ("maps", "message"),
    [
        ("normal", r"maps: expected some of 'normal', .*write maps=\('normal',\)"),
        (("normals",), "maps: .*found 'normals'; did you mean 'normal'"),
        (("status",), "maps: .*found 'status'; the status is always made"),
        ((), "maps: .*found none"),
        (3, "maps: .*found 3"),
        ((3,), "maps: .*found 3"),
    ],
)
def test_wrong_maps_are_refused(maps: Any, message: str) -> None:
    with pytest.raises(impasto.ArgumentError, match=message):
        impasto.fit_normals(stack(), maps=maps)


def test_memory_that_does_not_fit_is_refused() -> None:
    given = stack()
    good = impasto.fit_normals(given)

    def refused(out: Any, message: str, **options: Any) -> None:
        with pytest.raises(impasto.ArgumentError, match=message):
            impasto.fit_normals(given, out=out, **options)

    refused(good, "maps: .*give one of the two", maps=("normal",))
    refused(good.normal, "out: .*found ndarray")
    refused(
        good[:, :70], r"out.normal: expected float32 \(3, 37, 71\).*found float32 \(3, 37, 70\)"
    )
    refused(replace(good, sigma=good.sigma.astype(np.float64)), "out.sigma: .*found float64")
    refused(replace(good, albedo=good.albedo[:2]), "out.albedo: ")
    fixed = good.used.copy()
    fixed.setflags(write=False)
    refused(replace(good, used=fixed), "out.used: .*one piece")
    turned = replace(good, residual=np.asfortranarray(good.residual))
    refused(turned, "out.residual: .*one piece")


def test_a_lazy_stack_has_neither() -> None:
    array = pytest.importorskip("dask.array")
    given = stack()
    lazy = impasto.LazyStack(array.from_array(given.samples), lights=given.rig)
    for options in ({"maps": ("normal",)}, {"out": impasto.fit_normals(given)}):
        with pytest.raises(impasto.ArgumentError, match="lazy stack"):
            impasto.fit_normals(lazy, **options)  # type: ignore[call-overload]
