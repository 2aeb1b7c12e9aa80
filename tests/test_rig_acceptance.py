"""What photographs held out accept of a rig, from errors that are put in."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from impasto.fit.bundle_adjustment import Kind, RigNumbers
from impasto.fit.held_out import Errors
from impasto.fit.rig_acceptance import Found, chosen

LIGHTS, SAMPLES = 40, 400
ROUNDED = 0.3
"""Trimmed errors of up to 0.6 are then small."""


def found(kind: Kind, trim: float, *, coated: bool = False) -> Found:
    """A hypothesis with this trimmed error."""
    # One error in ten is large, and not counted.
    size = np.where(np.arange(SAMPLES) % 10 == 0, 50.0, trim)
    # A hundredth from photograph to photograph: a standard error of 0.02 dB, where a fall by 2 %
    # gains 0.17 dB.
    own = 1.0 + 0.01 * np.sin(np.arange(LIGHTS))
    test: Any = SimpleNamespace(coated=coated)
    state = RigNumbers(np.zeros(2), np.zeros(LIGHTS))
    return Found(state, kind, test, Errors(own[:, None] * size))


def taken(*tried: Found) -> tuple[Kind, bool]:
    """What is accepted, and whether its surfaces are under a varnish."""
    one = chosen(tried, ROUNDED)
    return one.kind, one.test.coated


def test_strengths_that_predict_better_are_accepted() -> None:
    given = found("given", 2.0)
    assert taken(given, found("held", 1.0), found("free", 1.0)) == ("held", False)
    assert taken(given, found("held", 1.0), found("free", 0.8)) == ("free", False)
    assert taken(given, found("held", 1.99), found("free", 1.99)) == ("given", False)


def test_strengths_are_compared_with_even_ones_under_either_kind_of_surface() -> None:
    """Strengths that stand for what a varnish keeps back are no better than the varnish."""
    without = [found("given", 2.0), found("held", 1.5), found("free", 1.0)]
    assert taken(*without)[0] == "free"
    assert taken(*without, found("given", 1.0, coated=True)) == ("given", True)


def test_tilt_and_fall_off_alone_are_not_accepted() -> None:
    """Errors of the model are smooth in the direction of light, and look like these."""
    assert taken(found("given", 2.0), found("held", 1.99), found("free", 1.0))[0] == "given"


def test_small_errors_show_strengths_only_if_they_fall_by_much() -> None:
    assert taken(found("given", 0.5), found("held", 0.45), found("free", 0.45))[0] == "given"
    assert taken(found("given", 0.5), found("held", 0.35), found("free", 0.35))[0] == "held"
    assert taken(found("given", 5.0), found("held", 4.5), found("free", 4.5))[0] == "held"


def test_surfaces_change_only_where_the_others_predict_better() -> None:
    given = found("given", 1.0)
    assert taken(given, found("given", 0.99, coated=True)) == ("given", False)
    assert taken(given, found("given", 0.97, coated=True)) == ("given", True)


def test_a_few_large_errors_do_not_scatter_a_gain() -> None:
    """A wrong camera misplaces highlights in some photographs, however right the lamps."""
    before, after = np.full((LIGHTS, SAMPLES), 2.0), np.full((LIGHTS, SAMPLES), 1.0)
    after[::3, ::20] = 50.0  # a twentieth of the samples of every third photograph
    gain = Errors(after).than(Errors(before))
    # Errors are halved: 6.02 dB; errors of 0.05 codes, which are added to both, take 0.01 of it.
    np.testing.assert_allclose(gain.gain, 20.0 * np.log10(2.0), atol=0.02)
    assert gain.scatter < 0.01


def test_tilt_and_fall_off_are_compared_under_the_same_surfaces() -> None:
    """Where lamps differ, a varnish that makes up for a part of the fall-off does not hide it."""
    tried = [found("given", 2.0), found("held", 0.75), found("free", 0.63)]
    assert taken(*tried, found("held", 0.68, coated=True)) == ("free", False)
