"""Options that belong to some fits only: refused by name wherever nothing would come of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto.fit.options import KINDS, fit_kinds, takers

SIZE = (4, 5)
LIGHTS = [(0.0, 0.6, 0.8), (0.6, 0.0, 0.8), (-0.6, 0.0, 0.8), (0.0, -0.6, 0.8)]
VALUES: dict[str, Any] = {
    "segments": np.zeros(SIZE, int),
    "lobes": 1,
    "ambient": True,
    "coated": True,
    "extraction": "residual",
    "peak": True,
    "joint": True,
    "index": 1.45,
}
"""Values that are good where the option is: none is refused for itself."""

FITS = [
    ({}, {"segments", "lobes", "ambient", "coated", "extraction", "peak", "joint", "index"}),
    ({"pooling": "none"}, set()),
    ({"pooling": "painting"}, {"coated", "extraction", "peak", "joint", "index"}),
    ({"pooling": "segment"}, {"segments", "extraction", "peak", "joint", "index"}),
    ({"pooling": "pixel"}, {"lobes", "ambient", "coated", "index"}),
    ({"model": "lafortune"}, {"lobes"}),
    ({"model": "lafortune", "pooling": "pixel"}, {"lobes"}),
]
"""By hand, from what the fits compute with."""

fit: Any = impasto.fit_sbrdf


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    return impasto.Stack(np.full((4, 3, *SIZE), 0.5, np.float32), lights=LIGHTS)


@pytest.mark.parametrize(("asked", "own"), FITS, ids=[str(asked) for asked, _ in FITS])
@pytest.mark.parametrize("option", VALUES)
def test_what_a_fit_does_not_have_is_refused(
    stack: impasto.Stack, asked: dict[str, Any], own: set[str], option: str
) -> None:
    needed = {"segments": VALUES["segments"]} if asked.get("pooling") == "segment" else {}
    options = asked | needed | {option: VALUES[option]}
    if option in own:
        fit(stack, **options)
        return
    with pytest.raises(impasto.ArgumentError) as refusal:
        fit(stack, **options)
    words = str(refusal.value)
    value = VALUES[option]
    found = "ndarray" if isinstance(value, np.ndarray) else repr(value)
    assert words.startswith(f"{option}: ")
    assert f"has no such option, found {found}; leave it out, or ask for " in words
    assert repr(takers(option)[0].chosen[1]) in words


def test_what_is_not_given_is_the_default(stack: impasto.Stack) -> None:
    for kind in KINDS:
        if kind.pooling == "segment":
            continue
        asked = {"model": kind.model, "pooling": kind.pooling}
        plain, told = fit(stack, **asked), fit(stack, **asked, **kind.defaults)
        for name in ("normal", "diffuse", "residual"):
            np.testing.assert_array_equal(getattr(plain, name), getattr(told, name), err_msg=name)


@pytest.mark.parametrize("pooling", ["painting", "segment"])
def test_lafortune_lobes_are_every_pixels_own(stack: impasto.Stack, pooling: str) -> None:
    words = f"pooling: model='lafortune' goes with 'auto' or 'pixel' only, found '{pooling}'"
    with pytest.raises(impasto.ArgumentError, match=words):
        fit(stack, model="lafortune", pooling=pooling, segments=VALUES["segments"])
    assert [kind.pooling for kind in fit_kinds("lafortune", "auto", {})] == ["pixel"]


@pytest.mark.parametrize("options", [asked for asked, _ in FITS], ids=str)
def test_an_array_is_no_stack(options: dict[str, Any]) -> None:
    with pytest.raises(impasto.ArgumentError, match=r"stack: .* found ndarray"):
        fit(np.ones((4, 3, *SIZE)), **options)


@pytest.mark.parametrize(
    ("asked", "name"), [({}, "joint"), ({"pooling": "pixel"}, "ambient"), ({}, "coated")]
)
@pytest.mark.parametrize("value", ["no", 0, 1.0, [True]])
def test_only_true_is_true(
    stack: impasto.Stack, asked: dict[str, Any], name: str, value: Any
) -> None:
    with pytest.raises(impasto.ArgumentError, match=f"{name}: expected True or False, found"):
        fit(stack, **asked, **{name: value})
    one, other = (fit(stack, **asked, **{name: no}) for no in (False, np.bool_(False)))
    np.testing.assert_array_equal(one.residual, other.residual)


def test_what_cannot_be_fitted_is_refused_before_segments_are_asked_for(
    stack: impasto.Stack,
) -> None:
    with pytest.raises(impasto.ArgumentError, match="pooling: model='lafortune' goes with"):
        fit(stack, model="lafortune", pooling="segment")
