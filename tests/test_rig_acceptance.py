"""What photographs held out accept of a rig, from errors that are put in."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from impasto.fit.bundle_adjustment import Kind, RigNumbers
from impasto.fit.held_out import Comparison, Errors
from impasto.fit.rig_acceptance import Found, chosen, convincing, strengths_differ

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
    test: Any = SimpleNamespace(surfaces="coated" if coated else "plain", coated=coated)
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


def scattered(gain: float, loss: float, *, before: float = 5.0) -> Comparison:
    """37 photographs gain so many dB, three lose: fewer than the tenth that a trim leaves out.

    Mean and scatter over photographs see the three, the fall of the trimmed error does not.
    """
    each = np.full(LIGHTS, before * 10.0 ** (-gain / 20.0))
    each[[3, 17, 31]] = before * 10.0 ** (loss / 20.0)
    held = [Errors(np.outer(one, np.ones(SAMPLES))) for one in (np.full(LIGHTS, before), each)]
    compared = held[1].than(held[0])
    # A gain of g dB is a fall by 1 - 10^(-g / 20).
    np.testing.assert_allclose(compared.fall, 1.0 - 10.0 ** (-gain / 20.0), rtol=1e-6)
    return compared


def errors_of(compared: Comparison) -> float:
    """The gain in standard errors."""
    return compared.gain / compared.scatter


def test_a_fall_by_much_needs_less_certainty() -> None:
    """25 % with 1.6 standard errors: either limit alone would refuse it."""
    much = scattered(2.5, 15.0)
    assert 1.2 < errors_of(much) < 2.5
    assert convincing(much)
    # As much, but less than a standard error.
    doubtful = scattered(2.5, 25.0)
    assert 0.0 < errors_of(doubtful) < 0.9
    assert not convincing(doubtful)
    # As certain, but by 13 %.
    less = scattered(1.2, 6.0)
    assert 1.2 < errors_of(less) < 2.5
    assert not convincing(less)
    # By 13 %, and certain.
    assert convincing(scattered(1.2, -1.2))
    # By 1 %, however certain.
    assert not convincing(scattered(0.09, -0.09))


def test_strengths_need_less_certainty_than_a_camera() -> None:
    """A fall by 13 % with 2.2 standard errors shows strengths, where errors are not of rounding."""
    less = scattered(1.2, 6.0)
    assert not convincing(less)
    assert strengths_differ(less, ROUNDED)
    assert not strengths_differ(scattered(1.2, 6.0, before=0.5), ROUNDED)
    assert not strengths_differ(scattered(1.2, 25.0), ROUNDED)
    # By 9 %, with 1.6.
    assert not strengths_differ(scattered(0.8, 5.0), ROUNDED)
    much = scattered(2.5, 15.0, before=0.5)
    assert strengths_differ(much, ROUNDED)


def test_tilt_and_fall_off_must_lower_the_error_by_a_tenth() -> None:
    assert taken(found("given", 2.0), found("held", 1.0), found("free", 0.95))[0] == "held"
    assert taken(found("given", 2.0), found("held", 1.0), found("free", 0.88))[0] == "free"
