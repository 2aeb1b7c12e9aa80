"""What is learned about a painting, saved and applied to tiles is the fit of the whole."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, simulate
from impasto.fit.learned import LearnedLobe

SIZE = (37, 50)
"""Pixels: no multiple of the seeds' step, of lanes or of tiles."""
TILES = [np.s_[0:13, 0:21], np.s_[13:37, 0:21], np.s_[0:13, 21:50], np.s_[13:37, 21:50]]
FITS: dict[str, dict[str, Any]] = {
    "painting": {"pooling": "painting"},
    "separate": {"pooling": "painting", "joint": False, "normals": "threshold"},
    "pixel": {"pooling": "pixel", "effort": "draft"},
    "multistart": {"pooling": "pixel", "effort": impasto.Effort(start="multistart", rounds=1)},
    "lafortune": {"model": "lafortune", "lobes": 1},
}
MAPS = ("normal", "diffuse", "residual", "sigma", "status", "specular", "gamma", "lobes", "misfit")


@cache
def stack(near: bool) -> impasto.Stack:
    painting = simulate.painting(seed=3, size=SIZE, varnish="gloss")
    taken = simulate.capture(painting, "tominaga-six-band-adaptation", "rgb").stack
    if not near:
        return taken
    lamps = [impasto.PointLight(tuple(80.0 * np.array(d))) for d in taken.rig.directions]
    rig = impasto.Rig(lamps, views=taken.rig.views, pitch_mm=0.3)
    return impasto.Stack(
        taken.samples, lights=rig, scale=taken.scale, black=taken.black, saturation=taken.saturation
    )


def assert_part(part: impasto.Sbrdf, whole: impasto.Sbrdf, place: Any) -> None:
    assert type(part) is type(whole)
    for name in MAPS:
        if np.ndim(getattr(whole, name, 0.0)):
            expected = np.ascontiguousarray(getattr(whole, name)[..., *place])
            found = np.ascontiguousarray(getattr(part, name))
            assert found.tobytes() == expected.tobytes(), name


@pytest.mark.parametrize("near", [False, True], ids=["distant", "near"])
@pytest.mark.parametrize("fit", FITS)
def test_tiles_of_a_saved_model_are_those_of_the_whole(
    fit: str, near: bool, tmp_path: Path
) -> None:
    photographs = stack(near)
    whole = impasto.fit_sbrdf(photographs, **FITS[fit])
    assert (whole.status == impasto.Status.FITTED).mean() > 0.5
    impasto.learn_sbrdf(photographs, **FITS[fit]).save(tmp_path / "learned.npz")
    learned = impasto.load_learned(tmp_path / "learned.npz")
    for place in TILES:
        assert_part(learned.apply(photographs, *place), whole, place)
    # A part that was cut, or read, by itself: it must hold the halo, and knows where it lies.
    rows, columns = slice(1, 37), slice(3, 50)
    part = photographs[rows, columns]
    halo = learned.halo
    inner = slice(halo, 36 - halo), slice(halo, 47 - halo)
    assert_part(
        learned.apply(part, *inner), whole, np.s_[1 + halo : 37 - halo, 3 + halo : 50 - halo]
    )


def test_a_tile_without_its_halo_is_refused() -> None:
    learned = impasto.learn_sbrdf(stack(False), pooling="pixel", effort="draft")
    assert learned.halo > 0
    with pytest.raises(impasto.GeometryError):
        learned.apply(stack(False)[10:20, 10:20])


def test_what_cannot_be_learned_or_applied_is_named(tmp_path: Path) -> None:
    photographs = stack(False)
    with pytest.raises(ArgumentError, match='pooling: "segment"'):
        impasto.learn_sbrdf(photographs, pooling="segment")
    with pytest.raises(ArgumentError, match="extent: "):
        impasto.learn_sbrdf(photographs, extent=(10, 10), pooling="painting")
    learned = impasto.learn_sbrdf(photographs, pooling="painting")
    one_band = impasto.Stack(np.ones((4, 1, *SIZE), np.float32), lights=np.eye(4)[:, :3] + 1.0)
    with pytest.raises(ArgumentError, match="expected 3 bands, found 1"):
        learned.apply(one_band)
    impasto.fit_sbrdf(photographs, pooling="painting").save(tmp_path / "fit.npz")
    with pytest.raises(impasto.CorruptInputError, match=r"fit\.npz"):
        impasto.load_learned(tmp_path / "fit.npz")


def test_a_model_says_in_words_what_was_learned() -> None:
    learned = {fit: impasto.learn_sbrdf(stack(near=False), **FITS[fit]) for fit in FITS}
    lobe = learned["painting"].fit
    assert isinstance(lobe, LearnedLobe)
    assert str(learned["painting"]) == (
        f"one lobe for the painting: beta {lobe.beta:.3g}, gamma {np.degrees(lobe.gamma):.3g} "
        f"degrees, {lobe.verdict}"
    )
    assert str(learned["pixel"]) == "torrance-sparrow, 2 lobes per pixel at most"
    assert str(learned["lafortune"]) == "lafortune, 1 lobe per pixel at most"
    assert str(impasto.learn_sbrdf(stack(near=False), pooling="none")) == "photometric stereo alone"
    chosen = impasto.learn_sbrdf(stack(near=False), refine=False)
    assert f"(chosen: {chosen.chosen})" in str(chosen)
