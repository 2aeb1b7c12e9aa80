"""What must not matter does not, whatever the painting: order, orientation, scale, absent samples.

Each property is asked of every fit that a user can call. The circumstances of a call (threads,
company, instruction sets) are varied in test_calls.py.

Samples come from tests/oracles: plain float64 numpy written from the papers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import impasto
from circumstances import LEARNED
from impasto import simulate
from impasto.effort import Origin
from impasto.fit.lobes import fit_lobes
from impasto.fit.normals import METHODS
from oracles import forward, lafortune_forward

SHAPE = (5, 9)
COUNT = 45


@dataclass(frozen=True)
class Scene:
    """Samples (obs, band, y, x), directions to lights and eyes (obs, 3)."""

    samples: Any
    lights: Any
    views: Any

    def stack(self) -> impasto.Stack:
        return impasto.Stack(self.samples, lights=impasto.Rig(self.lights, views=self.views))

    def pixels(self, order: Any) -> Scene:
        flat = self.samples.reshape(*self.samples.shape[:2], -1)[..., order]
        return Scene(flat.reshape(self.samples.shape), self.lights, self.views)

    def observations(self, order: Any) -> Scene:
        return Scene(self.samples[order], self.lights[order], self.views[order])

    def turned(self, turn: Any) -> Scene:
        return Scene(self.samples, self.lights @ turn.T, self.views @ turn.T)

    def scaled(self, power: int) -> Scene:
        return Scene(np.ldexp(self.samples, power), self.lights, self.views)

    def with_absent(self, place: int, value: float) -> Scene:
        """One more photograph that no pixel counts."""
        nothing = np.full_like(self.samples[0], value)
        return Scene(
            np.insert(self.samples, place, nothing, axis=0),
            np.insert(self.lights, place, (0.3, 0.4, 0.87), axis=0),
            np.insert(self.views, place, (0.0, 0.0, 1.0), axis=0),
        )


def scene(seed: int, lafortune: bool) -> Scene:
    """A bumpy painting under 60 lights, or 90 with a view each and half near the mirror."""
    rng = np.random.default_rng(seed)
    normal = np.concatenate([rng.normal(0.0, 0.12, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.6, (3, *SHAPE))
    count = 90 if lafortune else 60
    lights = rng.normal(0.0, 0.6, (count, 3))
    lights[:, 2] = 1.0
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    views = np.tile([0.0, 0.0, 1.0], (count, 1))
    if lafortune:
        views = lights * (-1.0, -1.0, 1.0) + rng.normal(0.0, 0.3, (count, 3))
        views[:, 2] = np.maximum(views[:, 2], 0.3)
        views /= np.linalg.norm(views, axis=1, keepdims=True)
        lobe = [np.full((1, *SHAPE), v) for v in (-1.0, 1.0, 30.0)]
        strength = np.broadcast_to(rng.uniform(0.2, 0.4, (1, 1, *SHAPE)), (1, 3, *SHAPE))
        rig = impasto.Rig(lights, views=views)
        clean = lafortune_forward.stack(normal, diffuse, strength, *lobe, rig)
    else:
        numbers = np.full(SHAPE, rng.uniform(8.0, 14.0)), np.full(SHAPE, rng.uniform(0.12, 0.2))
        clean = forward.stack(normal, diffuse, *numbers, impasto.Rig(lights))
    noisy = clean + 0.003 * rng.standard_normal(clean.shape)
    return Scene(noisy.astype(np.float32), lights, views)


# The calls ---------------------------------------------------------------------------------------


def normals(method: Any) -> Callable[..., Any]:
    return lambda stack, **options: impasto.fit_normals(
        stack, method=method, learned=LEARNED, **options
    )


def painting(stack: impasto.Stack, **options: Any) -> Any:
    return impasto.fit_sbrdf(stack, pooling="painting", **options)


def segment(stack: impasto.Stack, **options: Any) -> Any:
    parts = np.zeros(SHAPE, int)
    return impasto.fit_sbrdf(stack, pooling="segment", segments=parts, **options)


def pixel(stack: impasto.Stack, **options: Any) -> Any:
    return impasto.fit_sbrdf(stack, pooling="pixel", lobes=1, **options)


def apart(stack: impasto.Stack, threads: int = 1, start: Origin = "multistart") -> Any:
    """The same without what is typical of the painting, and without asking other pixels."""
    stereo = impasto.fit_normals(stack, learned=LEARNED)
    options = {
        "ambient": True,
        "index": 1.45,
        "threads": threads,
        "progress": False,
        "typical": False,
        "effort": impasto.Effort(start=start),
    }
    return fit_lobes(stack, stereo, lobes=1, **options)  # type: ignore[arg-type]


def neighbours(stack: impasto.Stack, threads: int = 1) -> Any:
    """From what some pixels found."""
    return apart(stack, threads, "neighbours")


def lafortune(stack: impasto.Stack, **options: Any) -> Any:
    normals = impasto.fit_normals(stack, learned=LEARNED)
    return impasto.fit_sbrdf(stack, model="lafortune", lobes=2, normals=normals, **options)


BY_ITSELF = {
    **{f"fit_normals, {method}": normals(method) for method in METHODS},
    "pixel, nothing typical": apart,
    "lafortune": lafortune,
}
"""Every pixel by itself."""
SHARING = {"painting": painting, "segment": segment, "pixel": pixel}
"""Pixels have something in common."""
FITS = BY_ITSELF | SHARING | {"pixel, neighbours": neighbours}
"""And where each lies in the picture matters, too."""

WHOLE = {f"fit_normals, {m}" for m in ("least-squares", "l1", "huber", "cauchy", "tukey")} | {
    "pixel"
}
"""Pixels that all photographs show are solved by all lights' pseudoinverse in double precision, and
others by sums of their own; what is typical of a painting weighs by how many photographs there are.
Both round otherwise with one more."""

by_itself = pytest.mark.parametrize("name", BY_ITSELF)
of_every_fit = pytest.mark.parametrize("name", FITS)
SEED = st.integers(0, 2**32 - 1)
EXAMPLES = settings(max_examples=4, deadline=None)


def maps(fit: Any) -> dict[str, Any]:
    found = {field.name: getattr(fit, field.name) for field in fields(fit)}
    kept = {k: v for k, v in found.items() if isinstance(v, np.ndarray) and v.shape[-2:] == SHAPE}
    # How many photographs were left out, and why, counts those that are not there.
    return {name: value for name, value in kept.items() if name != "rejected"}


def same_bits(one: Any, other: Any, order: Any = slice(None)) -> None:
    for name, plane in maps(one).items():
        flat = plane.reshape(*plane.shape[:-2], -1)[..., order]
        assert flat.tobytes() == maps(other)[name].tobytes(), name


ROUNDINGS = 1e-5
ODD = 2
"""Derived in :func:`near`."""


def near(one: Any, other: Any, turn: Any = None) -> None:
    """Normals alike but for roundings, and a tenth of their own error where a search ends early.

    60 to 90 samples in single precision (6e-8 each) are summed in another order, which is 90 * 6e-8
    = 5e-6 at most, and what is solved from the sums has a condition of about 2: 1e-5. A search may
    end where its cost is within 1e-4 of the least: sqrt(60 * 1e-4) = 0.08 standard deviations away.
    At an odd pixel that tips a choice (which samples count, how many lobes): criteria of n ln cost
    which differ by tens must lie within 60 * 1e-4 = 0.006 of each other, one pixel in a thousand
    or so. Three of 45 then are one painting in some 60,000.
    """
    expected = one.normal if turn is None else np.einsum("ij,jyx->iyx", turn, one.normal)
    moved = np.linalg.norm(other.normal - expected, axis=0)
    for fit in (one, other):
        np.testing.assert_array_equal(np.isnan(fit.normal).all(axis=0), fit.status >= 16)
    assert ((one.status >= 16) != (other.status >= 16)).sum() <= ODD
    known = np.isfinite(moved)
    assert np.median(moved[known]) < ROUNDINGS
    sigma = getattr(one, "sigma", None)
    if sigma is not None and np.isfinite(sigma[known]).all():
        assert (moved[known] > 0.1 * sigma[known] + ROUNDINGS).sum() <= ODD


@by_itself
@EXAMPLES
@given(seed=SEED)
def test_the_order_of_pixels_changes_no_bit(name: str, seed: int) -> None:
    given_scene = scene(seed, name == "lafortune")
    order = np.random.default_rng(seed).permutation(COUNT)
    one, other = (FITS[name](s.stack()) for s in (given_scene, given_scene.pixels(order)))
    same_bits(one, other, order)


@pytest.mark.parametrize("name", SHARING)
@EXAMPLES
@given(seed=SEED)
def test_the_order_of_pixels_hardly_matters_to_what_they_share(name: str, seed: int) -> None:
    given_scene = scene(seed, lafortune=False)
    order = np.random.default_rng(seed).permutation(COUNT)
    one, other = (FITS[name](s.stack()) for s in (given_scene, given_scene.pixels(order)))

    def moved(plane: Any) -> Any:
        flat = plane.reshape(*plane.shape[:-2], -1)[..., order]
        return flat.reshape(plane.shape)

    # 45 pixels of 60 photographs of three bands are 8100 terms in double precision (1e-16 each): in
    # another order their sum is another by 1e-12 at most, and what the search makes of it by some
    # times that. A map is in single precision: where such a number is rounded the other way, 6e-8.
    if np.ndim(one.gamma) == 0:
        assert other.gamma == pytest.approx(one.gamma, rel=1e-10)
    else:
        np.testing.assert_allclose(other.gamma, moved(one.gamma), rtol=2**-23)
    # The normals are searched for with that lobe, and end some roundings apart.
    np.testing.assert_allclose(other.normal, moved(one.normal), rtol=0, atol=1e-6)


@of_every_fit
@EXAMPLES
@given(seed=SEED)
def test_the_order_of_photographs_hardly_matters(name: str, seed: int) -> None:
    given_scene = scene(seed, name == "lafortune")
    order = np.random.default_rng(seed).permutation(len(given_scene.samples))
    near(*(FITS[name](s.stack()) for s in (given_scene, given_scene.observations(order))))


@of_every_fit
@EXAMPLES
@given(seed=SEED, angle=st.floats(-3.1, 3.1), lean=st.floats(-0.2, 0.2))
def test_turning_lights_and_eyes_turns_the_normals(
    name: str, seed: int, angle: float, lean: float
) -> None:
    given_scene = scene(seed, name == "lafortune")
    c, s = np.cos(angle), np.sin(angle)
    about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = np.cos(lean), np.sin(lean)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ about_z
    one, other = (FITS[name](s.stack()) for s in (given_scene, given_scene.turned(turn)))
    near(one, other, turn)


SHAPES = {"normal", "gamma", "gamma_sigma", "cxy", "cz", "exponent", "lobes", "sigma", "status"}
SHAPES |= {"specular_sigma", "direction_sigma", "exponent_sigma"}
COLOURS = {"albedo", "diffuse", "specular", "ambient", "residual"}


@of_every_fit
@EXAMPLES
@given(seed=SEED, power=st.integers(-20, 20))
def test_a_power_of_two_changes_no_bit_of_a_shape(name: str, seed: int, power: int) -> None:
    given_scene = scene(seed, name == "lafortune")
    one, other = (maps(FITS[name](s.stack())) for s in (given_scene, given_scene.scaled(power)))
    for key in SHAPES & set(one):
        assert one[key].tobytes() == other[key].tobytes(), key
    for key in COLOURS & set(one):
        np.testing.assert_array_equal(np.ldexp(one[key], power), other[key], key)


def test_a_power_of_two_changes_no_bit_of_what_photographs_hardly_determine() -> None:
    # Views that are not those of the photographs: no normal and no lobe fits, and searches end
    # wherever the last bit of a sum leads them.
    turns = 2.399963 * np.arange(24)
    height = 0.95 - 0.65 * (np.arange(24) + 0.5) / 24
    across = np.sqrt(1.0 - height**2)
    lights = np.stack([across * np.cos(turns), across * np.sin(turns), height], axis=1)
    rng = np.random.default_rng(0)
    views = lights[::-1] * (-1.0, -1.0, 1.0) + 0.2 * rng.normal(size=lights.shape)
    views[:, 2] = np.abs(views[:, 2]) + 0.2
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    painting = simulate.painting(0, (20, 20), varnish="patches")
    photographs = simulate.capture(painting, impasto.Rig(lights), "rgb").stack
    linear = np.array([photographs.linear(i) for i in range(24)], np.float32)
    linear[~np.isfinite(linear)] = np.nan
    one = lafortune(Scene(linear, lights, views).stack())
    assert (one.lobes > 0).any()
    for power in (-40, -20, -1, 1, 20, 40):
        other = lafortune(Scene(linear, lights, views).scaled(power).stack())
        for key in ("normal", "cxy", "cz", "exponent", "lobes", "sigma", "status"):
            assert getattr(one, key).tobytes() == getattr(other, key).tobytes(), (power, key)
        for key in ("diffuse", "specular", "residual"):
            scaled = np.ldexp(getattr(one, key), power)
            np.testing.assert_array_equal(scaled, getattr(other, key), f"{power} {key}")


@of_every_fit
@EXAMPLES
@given(seed=SEED, place=st.integers(0, 60), value=st.sampled_from([np.nan, -np.inf]))
def test_a_photograph_that_counts_nowhere_changes_no_bit(
    name: str, seed: int, place: int, value: float
) -> None:
    given_scene = scene(seed, name == "lafortune")
    other_scene = given_scene.with_absent(place, value)
    one, other = (FITS[name](s.stack()) for s in (given_scene, other_scene))
    if name in WHOLE:
        near(one, other)
    else:
        same_bits(one, other)


@of_every_fit
def test_any_number_of_threads_gives_the_same_bits(name: str) -> None:
    one = None
    for threads in (1, 2, 3, 5, 8):
        found = FITS[name](scene(1, name == "lafortune").stack(), threads=threads)
        same_bits(one or found, found)
        one = one or found


def angles_and_samples(seed: int) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    phi = rng.uniform(0.0, 0.6, (16, 70))
    width = rng.uniform(0.06, 0.4, 70)
    samples = rng.uniform(1.0, 200.0, 70) * np.exp(-np.log(2.0) * (phi / width) ** 2)
    return phi.astype(np.float32), (samples + rng.normal(0.0, 1.0, phi.shape)).astype(np.float32)


def lobe_maps(fit: impasto.HighlightFit) -> dict[str, Any]:
    return {field.name: getattr(fit, field.name) for field in fields(fit)}


@settings(max_examples=40, deadline=None)
@example(seed=229, power=2, place=0, threads=1)  # a lobe 8e18 times as strong as its one sample
@given(
    seed=SEED,
    power=st.integers(-20, 20),
    place=st.integers(0, 16),
    threads=st.sampled_from([1, 2, 3, 5, 8]),
)
def test_the_engine_by_itself(seed: int, power: int, place: int, threads: int) -> None:
    phi, samples = angles_and_samples(seed)
    plain = lobe_maps(impasto.fit_highlight(phi, samples, threads=1))
    order = np.random.default_rng(seed).permutation(70)
    shuffled = lobe_maps(impasto.fit_highlight(phi[:, order], samples[:, order], threads=threads))
    absent = lobe_maps(
        impasto.fit_highlight(
            np.insert(phi, place, 0.2, axis=0), np.insert(samples, place, np.nan, 0)
        )
    )
    scaled = lobe_maps(impasto.fit_highlight(phi, np.ldexp(samples, power)))
    for name, plane in plain.items():
        assert plane[..., order].tobytes() == shuffled[name].tobytes(), name
        assert plane.tobytes() == absent[name].tobytes(), name
    assert plain["gamma"].tobytes() == scaled["gamma"].tobytes()
    assert plain["status"].tobytes() == scaled["status"].tobytes()
    np.testing.assert_array_equal(np.ldexp(plain["beta"], power), scaled["beta"])
    # Photographs in another order are other roundings: a thousandth of an error at most.
    turned = np.random.default_rng(seed).permutation(16)
    mixed = impasto.fit_highlight(phi[turned], samples[turned])
    fitted = (plain["status"] == 0) & (mixed.status == 0)
    assert fitted.mean() > 0.9
    apart_by = np.abs(mixed.gamma - plain["gamma"]) / np.sqrt(plain["covariance"][2])
    assert np.percentile(apart_by[fitted], 95) < 0.01
