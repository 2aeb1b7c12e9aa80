"""Which changed areas are larger than chance, for every kind of fit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

import impasto
from cleaned_painting import CAMERA, LIGHTS, cleaned_painting, photographed
from impasto.comparison import load_comparison
from impasto.comparison.clusters import FAMILYWISE, ClusterSums, critical_extent
from impasto.comparison.entries import Compared

SIZE = (52, 64)
PATCH = (slice(14, 36), slice(16, 46))
PITCH = 0.25


def patch() -> NDArray[np.bool_]:
    found = np.zeros(SIZE, np.bool_)
    found[PATCH] = True
    return found


def maps_of(changed: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
    """Maps whose numbers tell pixels apart."""
    rng = np.random.default_rng(changed.size)
    numbers = rng.uniform(0.5, 2.0, (3, *changed.shape)).astype(np.float32)
    status = np.full(changed.shape, Compared.TESTED, np.uint8)
    return {"changed": changed, "status": status, "angle": numbers[0], "delta_e": numbers[1],
            "beta_ratio": numbers[2], "gamma_ratio": numbers[2]}  # fmt: skip


@pytest.mark.parametrize(("clusters", "continuation"), [(50, 0.35), (400, 0.6), (60, 0.9)])
def test_one_unchanged_painting_in_twenty_has_a_larger_cluster(
    clusters: int, continuation: float
) -> None:
    """Drawn sizes are geometric. The bound is the sum of the probabilities, which is larger than
    that of their union by a few percent, and a size is a whole number: one more pixel makes a
    cluster rarer by the continuation. 6000 draws know 5 % to 0.3 %; three of these are allowed.
    """
    rng = np.random.default_rng(7)
    largest = rng.geometric(1.0 - continuation, (6000, clusters)).max(axis=1)
    rate = float(np.mean(largest >= critical_extent(clusters, continuation)))
    assert rate < FAMILYWISE + 0.009
    assert rate > FAMILYWISE * continuation - 0.009


def test_dense_marks_tell_nothing() -> None:
    assert critical_extent(100, 0.97) == np.inf
    assert critical_extent(0, 0.35) >= 4


@pytest.mark.parametrize("tile", [5, 16, 64])
def test_clusters_do_not_depend_on_tiles(tile: int) -> None:
    """The oracle labels the whole painting by scipy, with corners."""
    rng = np.random.default_rng(3)
    smooth = ndimage.gaussian_filter(rng.normal(size=(61, 47)), 1.6)
    changed = np.where(smooth > 0.6 * smooth.std(), rng.integers(1, 8, smooth.shape), 0)
    changed = changed.astype(np.uint8)
    maps = maps_of(changed)
    sums = ClusterSums(changed.shape[1])
    for top in range(0, 61, tile):
        for left in range(0, 47, tile):
            part = slice(top, min(top + tile, 61)), slice(left, min(left + tile, 47))
            sums.add(part, {name: plane[part] for name, plane in maps.items()})
    extent, found = sums.clusters(changed.size, resampled=False, pitch_mm=PITCH)
    labels, count = ndimage.label(changed > 0, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())[1:]
    assert extent.chance == count
    assert sorted(one.pixels for one in found) == sorted(sizes[sizes >= extent.critical].tolist())
    assert len(found) >= 3
    boxes = ndimage.find_objects(labels)
    for one in found:
        number = next(n for n, (rows, columns) in enumerate(boxes) if sizes[n] == one.pixels
                      and (rows.start, columns.start) == (one.top, one.left))  # fmt: skip
        rows, columns = boxes[number]
        assert (one.rows, one.columns) == (rows.stop - rows.start, columns.stop - columns.start)
        own = labels == number + 1
        assert one.normal == pytest.approx(np.degrees(maps["angle"][own].mean()), rel=1e-5)
        assert one.colour == pytest.approx(maps["delta_e"][own].mean(), rel=1e-5)
        assert one.gloss == pytest.approx(np.exp(np.log(maps["beta_ratio"][own]).mean()), rel=1e-5)
        assert one.area_mm2 == pytest.approx(PITCH**2 * one.pixels)
        assert one.changed[1] == pytest.approx(((changed[own] & 2) > 0).mean())


KINDS: dict[str, dict[str, Any]] = {
    "pixel": {"pooling": "pixel", "lobes": 1, "ambient": False},
    "painting": {"pooling": "painting"},
    "lafortune": {"model": "lafortune", "lobes": 1},
    "segment": {"pooling": "segment", "segments": patch().astype(np.int64)},
}


def fits_of(kind: str) -> tuple[impasto.Sbrdf, impasto.Sbrdf, impasto.Sbrdf, NDArray[np.float64]]:
    """Before, after, before again, and the true colour differences."""
    one = cleaned_painting(SIZE, patch())
    fits = []
    for state, seed in ((one.before, 1), (one.after, 2), (one.before, 3)):
        fit = impasto.fit_sbrdf(photographed(state, seed), **KINDS[kind])
        fits.append(replace(fit, rig=impasto.Rig(fit.rig, pitch_mm=PITCH)))
    return fits[0], fits[1], fits[2], one.delta_e


@pytest.mark.parametrize("kind", KINDS)
def test_the_patch_that_was_cleaned_is_the_largest_changed_area(kind: str, tmp_path: Path) -> None:
    """And an unchanged painting has none.

    Of the 660 pixels of the patch those of dark paint change less than is significant, at most a
    third as ``test_compare.py`` shows, and borders add a few.
    """
    before, after, again, delta_e = fits_of(kind)
    found = impasto.compare(before, after, align="same", exposure_sigma=0.0)
    one = found.clusters[0]
    assert one.area_mm2 == pytest.approx(PITCH**2 * one.pixels)
    assert f"{one.left}, {one.top}" in str(found)
    for cluster in found.clusters:
        assert 14 - 2 <= cluster.top < cluster.top + cluster.rows <= 36 + 2
        assert 16 - 2 <= cluster.left < cluster.left + cluster.columns <= 46 + 2
    true = float(delta_e[PATCH].mean())
    assert 0.8 * true < one.colour < 1.5 * true
    if kind == "lafortune":
        # Its wide lobes and the slopes of photometric stereo explain each other: predicted errors
        # are large, and the patch is found in pieces.
        assert sum(cluster.pixels for cluster in found.clusters) > 60
    else:
        assert 0.6 * 660 < one.pixels < 1.1 * 660
    if kind != "painting":
        assert one.changed[2] > 0.6
        assert one.gloss < 0.5
    quiet = impasto.compare(before, again, align="same", exposure_sigma=0.0)
    assert quiet.extent.found == 0
    assert quiet.clusters == ()
    assert "or more: none" in str(quiet)
    for row in quiet.quantities:
        # A tenth of a percent is meant; a bound is what errors are at best, and lobes are found
        # by a search (docs/compare.md): two percent, where the change marks more than a fifth.
        assert row.significant < 0.02, row
    found.save(tmp_path / "a.npz")
    assert load_comparison(tmp_path / "a.npz").to_dict() == found.to_dict()


def test_a_normal_of_one_view_has_the_error_of_photometric_stereo() -> None:
    """Lafortune lobes seen from one view leave normals as they are: all pixels are tested.

    Each of 16 photographs in three bands has noise of 0.2 % of a white board, and paint is a fifth
    to a half as bright: 1 % / sqrt(48 / 3) is a quarter of a percent along an axis, a third of it
    in both paintings together, 0.2 degrees, of which 3.7 are significant: 0.8 degrees, and half as
    much or twice as much with the paint.
    """
    bare = cleaned_painting(SIZE, np.ones(SIZE, np.bool_)).after
    fits = [impasto.fit_sbrdf(photographed(bare, seed), **KINDS["lafortune"]) for seed in (1, 2)]
    found = impasto.compare(fits[0], fits[1], align="same")
    assert found.compared == {"tested": SIZE[0] * SIZE[1]}
    row = found.quantity("normal")
    assert 0.4 < row.detectable < 1.6
    assert row.significant < 0.005


def test_gloss_of_a_segment_that_became_duller() -> None:
    """Strengths of both segments are known; that of one is halved."""
    rng = np.random.default_rng(5)
    slope = 0.1 * rng.normal(size=(2, *SIZE))
    normal = np.concatenate([slope, np.ones((1, *SIZE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.6, (3, *SIZE))
    regions = np.zeros(SIZE, np.int64)
    regions[:, 32:] = 1
    fits = []
    for seed, factor in ((1, 1.0), (2, 0.5)):
        beta = np.where(regions == 1, 3.0 * factor, 3.0)
        surface = impasto.Surface.torrance_sparrow(normal, diffuse, beta, 0.2)
        stack = photographed(surface, seed)
        fits.append(impasto.fit_sbrdf(stack, pooling="segment", segments=regions))
    found = impasto.compare(*fits, align="same", regions=regions)
    gloss = {area.name: area for area in found.areas}
    assert gloss["1"].gloss == pytest.approx(0.5, rel=0.02)
    assert gloss["0"].gloss == pytest.approx(1.0, rel=0.02)
    # All of a segment's pixels but those at its border, which have no gloss of their own.
    assert gloss["1"].changed[2] == pytest.approx(31 / 32, abs=0.001)
    assert gloss["0"].changed[2] == 0.0
    assert found.quantity("gloss").tested == SIZE[0] * (SIZE[1] - 2)


def test_comparisons_of_before_there_were_clusters_are_read(tmp_path: Path) -> None:
    shown = cleaned_painting((12, 14), np.zeros((12, 14), np.bool_)).before.predict(LIGHTS)
    fit = impasto.fit_sbrdf(impasto.Stack(shown, lights=LIGHTS, bands=CAMERA.bands),
                            pooling="painting")  # fmt: skip
    impasto.compare(fit, fit, align="same").save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as file:
        arrays = dict(file)
    content = json.loads(str(arrays["report"]))
    del content["extent"], content["clusters"]
    np.savez(tmp_path / "old.npz", **(arrays | {"report": np.array(json.dumps(content))}))
    old = load_comparison(tmp_path / "old.npz")
    assert old.clusters == ()
    assert "not told from chance" in str(old)
