"""What every kind of result says: its gloss, one pixel, a diagram, a picture."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, Status
from test_sbrdf_xarray import KINDS, SIZE, facets, lafortune, pooled, segmented


def flat(result: Any) -> Any:
    """The result with a normal that is one and modest numbers in every map."""
    normal = np.zeros((3, *SIZE), np.float32)
    normal[0], normal[2] = 0.6, 0.8
    changes: dict[str, Any] = {
        "normal": normal,
        "diffuse": np.full((3, *SIZE), 0.25, np.float32),
        "sigma": np.full(SIZE, 0.01, np.float32),
        "residual": np.full(SIZE, 0.02, np.float32),
    }
    modest = {"beta": 2.0, "gamma": 0.1, "specular": 0.5, "cxy": -1.0, "cz": 1.0, "exponent": 9.0}
    for name, value in modest.items():
        if isinstance(getattr(result, name, None), np.ndarray):
            changes[name] = np.full_like(getattr(result, name), value)
    return replace(result, **changes)


@KINDS
def test_every_kind_has_a_pair_with_its_spread(make: Any) -> None:
    gloss = flat(make()).gloss
    assert isinstance(gloss, impasto.Gloss)
    assert gloss.source == ("fit" if make in (pooled, segmented) else "pixels")
    for value, (low, high) in ((gloss.beta, gloss.beta_range), (gloss.gamma, gloss.gamma_range)):
        assert low <= value <= high
        assert all(type(number) is float for number in (value, low, high))
    assert "np." not in repr(gloss)
    assert "°" in str(gloss)


def test_the_pooled_pair_has_the_fits_deviations() -> None:
    gloss = replace(pooled(), covariance=np.diag([0.01, 0.04])).gloss
    assert (gloss.beta, gloss.gamma, gloss.share) == (1.5, 0.1, 0.9)
    assert gloss.beta_range == pytest.approx((1.5 * math.exp(-0.1), 1.5 * math.exp(0.1)))
    assert gloss.gamma_range == pytest.approx((0.1 * math.exp(-0.2), 0.1 * math.exp(0.2)))
    assert segmented().gloss == pooled().gloss
    dull = replace(pooled(), beta=0.0, covariance=np.diag([np.inf, np.inf])).gloss
    assert (dull.beta, str(dull)) == (0.0, "no highlight")
    assert math.isnan(dull.gamma)


def test_the_pixels_pair_is_the_median_of_their_strongest_lobes() -> None:
    """Twenty pixels, one masked: 19 of which 15 have a lobe; the wide one reflects more."""
    result = facets()
    lobes = np.full(SIZE, 2, np.uint8)
    lobes[0, 1:] = 0
    specular = np.zeros((2, 3, *SIZE), np.float32)
    gamma = np.full((2, *SIZE), np.nan, np.float32)
    specular[0, :, 1:], gamma[0, 1:] = 100.0, 0.01
    # Strength times width squared: 0.01 of the first, at least 0.04 of the second.
    strengths = np.arange(1.0, 16.0, dtype=np.float32).reshape(3, 5)
    specular[1, :, 1:], gamma[1, 1:] = strengths, 0.2
    gloss = replace(result, specular=specular, gamma=gamma, lobes=lobes).gloss
    assert gloss.beta == 8.0
    assert gloss.gamma == pytest.approx(0.2)
    # 16 % and 84 % of the way from the first of 15 to the last.
    assert gloss.beta_range == pytest.approx((1.0 + 0.16 * 14, 1.0 + 0.84 * 14))
    assert gloss.share == pytest.approx(15 / 19)
    none = replace(result, specular=0.0 * specular, gamma=gamma, lobes=0 * lobes).gloss
    assert (none.beta, none.share) == (0.0, 0.0)


def test_a_phong_lobe_is_as_bright_as_its_beta() -> None:
    """The gloss of Lafortune lobes, rendered as a Torrance-Sparrow lobe: the same frontal peak."""
    gloss = flat(lafortune()).gloss
    normal = np.zeros((3, 1, 1))
    normal[2] = 1.0
    black = np.zeros((1, 1, 1))
    facing = [(0.0, 0.0, 1.0)]
    peak = impasto.Surface.torrance_sparrow(normal, black, gloss.beta, gloss.gamma).predict(facing)
    # A strength of 0.5; some roundings of 6e-8.
    assert peak.item() == pytest.approx(0.5, rel=1e-5)


@KINDS
def test_a_pixel_says_all_that_is_known_of_it(make: Any) -> None:
    result = flat(make())
    one = result.pixel(-1, 2)
    assert (one.y, one.x, one.status) == (SIZE[0] - 1, 2, Status.FITTED)
    assert one.diffuse == {f"band{i}": 0.25 for i in range(3)}
    # The components 0.6 and 0.8 are single-precision numbers.
    assert one.tilt == pytest.approx(math.atan2(0.6, 0.8), rel=1e-6)
    assert one.azimuth == 0.0
    assert one.lobes
    names = {"gamma"} if make is not lafortune else {"cxy", "cz", "exponent"}
    assert one.lobes[0].shape.keys() == names
    text = repr(one)
    assert "np." not in text
    assert "36.9° towards 0°" in text
    assert one.reason in text
    lost = replace(result, normal=np.where(result.status > 15, np.nan, result.normal)).pixel(0, 0)
    assert (lost.status, lost.lobes) == (Status.MASKED, ())
    assert "outside the mask" in repr(lost)
    with pytest.raises(ArgumentError, match="x: 5 is outside a painting of 5"):
        result.pixel(0, 5)
    with pytest.raises(ArgumentError, match=r"y: expected a whole number, found 0\.5"):
        result.pixel(0.5, 0)


def test_every_status_has_a_reason() -> None:
    assert all(status.reason for status in Status)
    assert len({status.reason for status in Status}) == len(Status)


@KINDS
def test_every_kind_draws_a_pixels_lobes(make: Any, tmp_path: Any) -> None:
    result = flat(make())
    samples = np.full((3, 3, *SIZE), 0.3, np.float32)
    figure = result.lobe_plot(2, 3, impasto.Stack(samples, lights=result.rig))
    (total,) = (line for line in figure.axes[0].lines if line.get_label() == "all")
    parts = [line for line in figure.axes[0].lines if "lobe" in str(line.get_label())]
    assert parts
    # The diffuse reflectance is the smallest radius, and lobes lie above it.
    assert total.get_ydata().min() == pytest.approx(0.25, rel=1e-5)
    assert total.get_ydata().max() > 0.28
    words = "n = 9" if make is lafortune else "gamma = 5.73°"
    assert words in str(parts[0].get_label())
    figure.savefig(tmp_path / "lobes.png")
    with pytest.raises(ArgumentError, match="its status is MASKED"):
        result.lobe_plot(0, 0)


def test_a_diagram_needs_matplotlib(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(impasto.MissingExtraError, match=r"impasto\[plot\]"):
        pooled().lobe_plot(1, 1)


@KINDS
def test_a_result_renders_itself(make: Any) -> None:
    result = flat(make())
    scene = impasto.Scene([(0.0, 0.6, 0.8)])
    assert result.render(scene).xyz.tobytes() == impasto.render(result, scene).xyz.tobytes()


def test_only_estimated_pixels_count_as_without_lobes() -> None:
    result = facets()
    lobes = np.ones(SIZE, np.uint8)
    lobes[0, :3] = 0
    # The first of the three is masked.
    assert replace(result, lobes=lobes).report()["lobes"] == [2, 17, 0]


def test_lamps_of_a_file_have_their_size(tmp_path: Any) -> None:
    result = flat(facets())
    lights = [replace(light, radius=0.02) for light in result.rig.lights[:-1]]
    rig = impasto.Rig([*lights, result.rig.lights[-1]], views=result.rig.viewpoints)
    replace(result, rig=rig).save(tmp_path / "fit.npz")
    np.testing.assert_array_equal(impasto.load_sbrdf(tmp_path / "fit.npz").rig.radii, rig.radii)
    assert rig.radii[0] > 0.0
