"""Crops and quarter turns of stacks, rigs and results."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, DistantLight, PointLight
from test_sbrdf_xarray import KINDS, SIZE, facets, pooled

PART = np.s_[1:4, 2:5]
NEAR = [PointLight((30.0, -10.0, 40.0), 0.8), PointLight((-25.0, 20.0, 55.0), falloff=False)]
FAR = [DistantLight((0.3, 0.5, 0.8)), DistantLight((-0.6, 0.1, 0.7), 0.5)]


def maps(result: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Every array of a result and of the results in it, by name."""
    found: dict[str, np.ndarray] = {}
    for one in fields(result):
        value = getattr(result, one.name)
        if isinstance(value, impasto.Rig):
            found |= {
                f"{prefix}rig.{name}": np.asarray(getattr(value, name))
                for name in ("vectors", "views", "intensities", "origin")
            }
        elif is_dataclass(value):
            found |= maps(value, f"{prefix}{one.name}.")
        elif isinstance(value, np.ndarray):
            found[prefix + one.name] = value
    return found


def lit(result: Any, lights: Any = NEAR, size: tuple[int, int] = SIZE) -> Any:
    """The result with unit normals and modest numbers, lit by these lights and from two views."""
    rng = np.random.default_rng(3)
    normal = rng.normal(0.0, 0.2, (3, *size))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    changes: dict[str, Any] = {
        "normal": normal.astype(np.float32),
        "diffuse": rng.uniform(0.1, 0.8, (3, *size)).astype(np.float32),
        "rig": impasto.Rig(lights, views=[(0.1, -0.3, 0.9), (0, 0, 1)], pitch_mm=2.0),
    }
    for name, low, high in (
        ("beta", 0.5, 3.0), ("gamma", 0.1, 0.3), ("specular", 0.1, 0.5), ("ambient", 0.0, 0.1),
        ("cxy", -1.1, -0.9), ("cz", 0.9, 1.1), ("exponent", 5.0, 20.0),
    ):  # fmt: skip
        value = getattr(result, name, None)
        if isinstance(value, np.ndarray):
            changes[name] = rng.uniform(low, high, value.shape).astype(np.float32)
    return replace(result, **changes)


@KINDS
def test_four_quarter_turns_change_no_bit(make: Any) -> None:
    whole = lit(make())
    four = whole
    for _ in range(4):
        four = four.rotated(1)
    before, after = maps(whole), maps(four)
    assert before.keys() == after.keys()
    assert {name for name in before if before[name].tobytes() != after[name].tobytes()} == set()
    assert whole.rotated(4) is whole
    three, back = maps(whole.rotated(3)), maps(whole.rotated(-1))
    assert all(three[name].tobytes() == back[name].tobytes() for name in three)


@KINDS
@pytest.mark.parametrize("lights", [FAR, NEAR], ids=["far", "near"])
def test_a_rotated_result_predicts_the_rotated_photographs(make: Any, lights: Any) -> None:
    whole = lit(make(), lights)
    rotated = whole.rotated(1)
    assert rotated.shape == SIZE[::-1]
    # x and y change places in sums of three products, each rounded to 6e-8; a lobe's exponent of up
    # to 20 multiplies that. Samples are of the order of 1.
    np.testing.assert_allclose(
        rotated.predict(), np.rot90(whole.predict(), axes=(2, 3)), rtol=1e-5, atol=2e-6
    )


def test_a_quarter_turn_is_counterclockwise() -> None:
    """A light from the right comes from above afterwards, and so does the pixel at the right."""
    rig = impasto.Rig([(0.6, 0.0, 0.8)]).rotated(1)
    np.testing.assert_array_equal(rig.directions, [[0.0, 0.6, 0.8]])
    samples = np.zeros((1, 1, 3, 3), np.float32)
    samples[0, 0, 1, 2] = 0.5
    rotated = impasto.Stack(samples, lights=[(0.6, 0.0, 0.8)]).rotated()
    assert rotated.samples[0, 0, 0, 1] == 0.5


@KINDS
def test_a_part_shows_its_part_of_the_photographs(make: Any) -> None:
    whole = lit(make(), FAR)
    part = whole[PART]
    assert type(part) is type(whole)
    assert part.shape == (3, 3)
    # Under distant lights a pixel does not know where it lies: the same bits.
    assert part.predict().tobytes() == whole.predict()[:, :, *PART].tobytes()
    assert part.normals.shape == (3, 3)
    assert np.shares_memory(part.normal, whole.normal)


@KINDS
def test_near_lights_stay_where_they_are_over_a_part(make: Any) -> None:
    whole = lit(make(), NEAR)
    part = whole[PART][0:2, 1:3]
    expected = whole.predict()[:, :, 1:3, 3:5]
    # The part's pixels have the coordinates that they have in the whole: the same bits.
    np.testing.assert_array_equal(part.predict(), expected)
    assert abs(part.predict()[0] / whole[0:2, 0:2].predict()[0] - 1.0).max() > 0.01
    # The lamp given anew stands where it stood: positions are the painting's.
    np.testing.assert_array_equal(part.predict(whole.rig)[0], part.predict()[0])
    scene = impasto.Scene([NEAR[0]], exposure=1.0)
    if len(whole.bands) == 3:
        np.testing.assert_allclose(
            part.render(scene).xyz, impasto.render(whole, scene).xyz[:, 1:3, 3:5], rtol=1e-5
        )


def test_a_part_keeps_its_position_when_the_painting_is_rotated() -> None:
    whole = lit(pooled(), NEAR)
    height, width = SIZE
    rotated = whole[PART].rotated(1)
    rows, columns = slice(width - 5, width - 2), slice(1, 4)
    again = whole.rotated(1)[rows, columns]
    assert rotated.rig.origin == again.rig.origin
    assert rotated.normal.tobytes() == again.normal.tobytes()
    assert height == 4


def test_a_part_is_saved_and_read_with_its_place(tmp_path: Any) -> None:
    part = lit(pooled())[PART]
    part.save(tmp_path / "part.npz")
    read = impasto.load_sbrdf(tmp_path / "part.npz")
    assert read.rig.origin == part.rig.origin == (1.0, -0.5)
    assert read.predict().tobytes() == part.predict().tobytes()
    # Two pixels of 2 mm to the right of the middle column of five, and the rows below the middle.
    np.testing.assert_allclose(part.to_xarray()["x"], [0.0, 2.0, 4.0])
    np.testing.assert_allclose(part.to_xarray()["y"], [1.0, -1.0, -3.0])


def stack(lights: Any) -> impasto.Stack:
    rng = np.random.default_rng(5)
    mask = np.ones((6, 7), bool)
    mask[2, 5] = False
    codes = rng.integers(0, 200, (2, 3, 6, 7)).astype(np.uint8)
    return impasto.Stack(
        codes, lights=impasto.Rig(lights, pitch_mm=2.0), mask=mask, saturation=180, names=["a", "b"]
    )


def test_a_stack_is_cropped_and_rotated_with_its_mask_and_lights() -> None:
    whole = stack(NEAR)
    part = whole[2:5, 3:]
    np.testing.assert_array_equal(part.samples, whole.samples[:, :, 2:5, 3:])
    assert part.mask is not None
    assert not part.mask[0, 2]
    assert (part.names, part.rig.origin) == (("a", "b"), (1.5, -0.5))
    np.testing.assert_array_equal(part.saturation, whole.saturation)
    rotated = whole.rotated(1)
    np.testing.assert_array_equal(rotated.samples, np.rot90(whole.samples, axes=(2, 3)))
    np.testing.assert_array_equal(rotated.mask, np.rot90(whole.mask))
    four = rotated.rotated(3)
    assert four.samples.tobytes() == whole.samples.tobytes()
    assert four.rig.vectors.tobytes() == whole.rig.vectors.tobytes()


def test_normals_of_a_part_are_the_parts_normals() -> None:
    """Distant lights: no pixel knows of another one; near ones: from another origin."""
    rng = np.random.default_rng(8)
    lights = [(0.5, 0.1, 0.8), (-0.4, 0.4, 0.8), (0.0, -0.5, 0.8), (0.1, 0.2, 0.9), (0.3, 0.6, 0.7)]
    near = [PointLight((60 * x, 60 * y, 60 * z)) for x, y, z in lights]
    for lamps, tolerance in ((lights, 0.0), (near, 0.0)):
        rig = impasto.Rig(lamps, pitch_mm=2.0)
        samples = rng.uniform(0.2, 0.6, (5, 1, 6, 7)).astype(np.float32)
        whole = impasto.Stack(samples, lights=rig)
        options: Any = {"method": "least-squares"}
        expected = impasto.fit_normals(whole, **options)[2:5, 3:6]
        found = impasto.fit_normals(whole[2:5, 3:6], **options)
        # Least squares of five lights: condition below 10, a few roundings of 6e-8.
        np.testing.assert_allclose(found.normal, expected.normal, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("key", "words"),
    [
        (np.s_[1, 2], "one or two slices"),
        (np.s_[1:2, 0:1, 0:1], "one or two slices"),
        (np.s_[::2], "y: expected a slice of step 1, found 2"),
        (np.s_[:, 4:4], "x: the slice holds none of 5 pixels"),
        (np.s_[0.5:2], "y: expected whole numbers in a slice, found 0.5"),
        (np.s_[..., 0:2], "one or two slices"),
    ],
)
def test_what_is_no_part_is_refused(key: Any, words: str) -> None:
    for thing in (pooled(), pooled().normals, impasto.Stack(np.ones((3, 4, 5)), lights=np.eye(3))):
        with pytest.raises(ArgumentError, match=words):
            thing[key]
    with pytest.raises(ArgumentError, match="quarter_turns"):
        pooled().rotated(0.5)  # type: ignore[arg-type]


def test_a_part_is_rendered_under_lamps_of_different_reach() -> None:
    """Two near lights at once: each arrives at the part with a strength of its own."""
    whole = lit(facets(), NEAR)
    scene = impasto.Scene(NEAR, exposure=1.0)
    # As above: another origin in single precision.
    np.testing.assert_allclose(
        whole[PART].render(scene).xyz, whole.render(scene).xyz[:, *PART], rtol=1e-5
    )
