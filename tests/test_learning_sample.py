"""A large painting is learned from a systematic sample: every so many rows and columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, DistantLight, PointLight, Rig, simulate
from impasto.fit import subsample
from impasto.fit.relief import Relief
from impasto.fit.subsample import Sample
from impasto.io import write_stack
from job_photographs import PIXEL, photographs, same
from killed_jobs import stack

pytest.importorskip("fcntl", reason="jobs need POSIX")


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A painting of 125 x 142 pixels is a large one."""
    monkeypatch.setattr(subsample, "LEARNED_PIXELS", 5000)


def test_two_million_pixels_and_as_many_samples_as_fit_into_memory() -> None:
    def stride_of(size: tuple[int, int], planes: int, inside: Any) -> int:
        return Sample.to_learn(size, planes, inside).stride

    def all_of(some: Sample) -> int:
        return some.count(None)

    # 1448 squared is just below 2^21; 770 views in three bands: 2^28 samples are 116,000 pixels.
    cases = [(1448, 36, 1), (1449, 36, 3), (32768, 96, 23), (340, 2310, 1), (342, 2310, 3)]
    for side, planes, stride in cases:
        assert stride_of((side, side), planes, all_of) == stride
    # A narrow picture keeps all of its rows.
    assert stride_of((1, 60_000_000), 36, all_of) == 29
    # Ten thousand pixels of a mask, far apart: at most four times two million are taken.
    assert stride_of((32768, 32768), 36, lambda some: 10_000 // some.stride**2) == 13


def test_a_sample_has_pixels_of_the_mask(small: None) -> None:
    """A mask may be a sample itself, whose holes coincide with the stride."""
    size = (125, 142)
    taken = stack(size)
    assert Sample.of(taken).stride == 3
    few = np.zeros(size, bool)
    few[::7, ::3] = True  # 864 pixels, few enough, in a picture that is not much larger
    assert Sample.of(taken._replace(mask=few)).stride == 1
    most = np.ones(size, bool)
    most[2::3] = False  # all rows of every third
    assert Sample(3, size).taken(taken._replace(mask=most)).mask.any() is np.False_  # type: ignore[union-attr]
    assert Sample.of(taken._replace(mask=most)).stride == 1


@pytest.mark.parametrize("size", [(125, 142), (7, 11), (10, 1)])
@pytest.mark.parametrize("stride", [3, 5, 9])
def test_the_sample_lies_about_the_middle(size: tuple[int, int], stride: int) -> None:
    """Near lamps keep their places: a pixel of the sample sees the lamp that it saw before."""
    lamp = PointLight((30.0, -20.0, 100.0))
    rig = Rig([lamp, lamp, lamp], pitch_mm=0.5)
    y, x = np.mgrid[: size[0], : size[1]].astype(np.uint8)
    taken = impasto.Stack(np.array([[y], [x], [y]]), lights=rig)
    some = Sample(stride, size).taken(taken)
    rows, columns = (some.samples[0, 0][:, 0].astype(int), some.samples[1, 0][0].astype(int))
    for picked, length, width in ((rows, size[0], 0.5 * stride), (columns, size[1], 0.5 * stride)):
        assert (np.diff(picked) == stride).all()
        # Where the rig of the sample has its pixels, in millimetres from the middle, and where
        # they were; all of it is whole or half pixels, without rounding.
        has = (np.arange(len(picked)) - (len(picked) - 1) / 2) * width
        assert has.tolist() == ((picked - (length - 1) / 2) * 0.5).tolist()
    assert some.rig.pitch_mm == 0.5 * stride
    assert some.rig.origin == (0.0, 0.0)


@pytest.mark.parametrize("fit", [PIXEL, {"pooling": "painting"}], ids=["pixel", "painting"])
def test_a_fit_is_the_model_of_the_sample_applied_to_all(fit: dict[str, Any], small: None) -> None:
    taken = stack((125, 142))
    few = impasto.learn_sbrdf(Sample(3, (125, 142)).taken(taken), **fit, sample=1)
    learned = impasto.learn_sbrdf(taken, **fit)
    assert learned.extent == (125, 142)
    assert learned.stereo == few.stereo
    whole = impasto.fit_sbrdf(taken, **fit)
    same(whole, learned.apply(taken))
    # It is another model than that of all pixels.
    all_pixels = impasto.learn_sbrdf(taken, **fit, sample=1)
    assert whole.normal.tobytes() != all_pixels.apply(taken).normal.tobytes()
    with pytest.raises(ArgumentError, match="sample: expected an odd number"):
        impasto.learn_sbrdf(taken, sample=4)


@pytest.mark.parametrize("memory", ["1GiB", "10.5MB"])
def test_a_job_in_little_memory_is_the_fit_of_the_whole(
    memory: str, small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also with a mask in a file, of which parts are read, and fits that look at neighbours."""
    path = photographs(tmp_path, (125, 142))
    monkeypatch.chdir(tmp_path)
    reading = {"mask": "mask.png"}
    out = impasto.run(path, "painting.zarr", memory=memory, reading=reading, tile=64, **PIXEL)
    whole = impasto.fit_sbrdf(impasto.read_stack(path, **reading), **PIXEL)
    same(impasto.load_sbrdf(out), whole)


@pytest.mark.parametrize("suffix", [".npz", ".zarr"])
def test_the_mask_of_a_finished_stack_counts(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subsample, "LEARNED_PIXELS", 1900)
    mask = np.zeros((125, 142), bool)
    mask[20:110, 20:120] = True
    taken = stack((125, 142))._replace(mask=mask)
    assert (Sample.of(taken).stride, Sample.of(stack((125, 142))).stride) == (3, 5)
    path = tmp_path / f"stack{suffix}"
    if suffix == ".npz":
        write_stack(path, taken)
    else:
        impasto.ingest(taken, path, tile=64)
    out = impasto.run(path, tmp_path / "painting.zarr", memory="10.5MB", tile=64, **PIXEL)
    same(impasto.load_sbrdf(out), impasto.fit_sbrdf(taken, **PIXEL))


def test_a_part_of_a_painting_is_fitted_by_itself(small: None) -> None:
    part = stack((125, 142))[6:120, 20:138]
    assert part.rig.origin != (0.0, 0.0)
    assert Sample.of(part).stride == 3
    found = impasto.fit_sbrdf(part, **PIXEL)
    assert (found.status == impasto.Status.FITTED).mean() > 0.5


def test_the_relief_of_a_sample_is_that_of_the_painting() -> None:
    """In pixels a third as wide everything is three times as large, lamps too."""
    rng = np.random.default_rng(5)
    height = rng.normal(0.0, 1.0, (24, 20)).cumsum(axis=0).astype(np.float32)
    normal = np.stack([-np.gradient(height, axis=1), np.gradient(height, axis=0), 1.0 + 0 * height])
    normal = (normal / np.linalg.norm(normal, axis=0)).astype(np.float32)
    diffuse = rng.random((3, 24, 20), dtype=np.float32)
    few = Relief(height, normal, diffuse, 1, np.array([2.0, -1.5]), True)
    lights = [DistantLight((0.6, 0.2, 0.5)), PointLight((9.0, -6.0, 14.0))]
    ambient = 0.1 * diffuse
    shown = rng.random((2, 3, 24, 20), dtype=np.float32)
    wanted = shown.copy()
    few.add_to(wanted, diffuse, ambient, Rig(lights, pitch_mm=0.6))
    assert np.abs(wanted - shown).max() > 0.1
    found = np.repeat(np.repeat(shown, 3, axis=-2), 3, axis=-1)
    larger = [np.repeat(np.repeat(one, 3, axis=-2), 3, axis=-1) for one in (diffuse, ambient)]
    few.magnified(3).add_to(found, *larger, Rig(lights, pitch_mm=0.6 / 3))
    # Every third pixel lies in the middle of a cell. Lengths are rounded anew, once or twice: some
    # units of 6e-8, which visibility, the slope of a horizon, may multiply by its steepness, 10.
    np.testing.assert_allclose(found[..., 1::3, 1::3], wanted, atol=5e-6)


def test_a_sample_is_enough_for_one_lobe(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a ninth of the pixels the lobe is that of all, within its standard deviation."""
    painting = simulate.painting(seed=3, size=(150, 160), varnish="gloss")
    taken = simulate.capture(painting, "tominaga-six-band-adaptation", "rgb").stack
    whole = impasto.fit_sbrdf(taken, pooling="painting")
    monkeypatch.setattr(subsample, "LEARNED_PIXELS", 3000)
    assert Sample.of(taken).stride == 3
    found = impasto.fit_sbrdf(taken, pooling="painting")
    spread = np.sqrt(np.diag(found.covariance))
    change = np.log([found.beta / whole.beta, found.gamma / whole.gamma])
    # Three standard deviations of what a sample of this size leaves open.
    assert (np.abs(change) < 3.0 * spread).all()
    assert np.abs(change).max() > 0.0
