"""Incomplete chromatic adaptation on the mired scale [@tominaga-six-band-adaptation].

Eq. 7 and 9 to 12 of the paper.

The von Kries matrix is computed here. That of colour-science agrees to 4e-16, but is not the
identity for equal whites, and accepts lights that are no white to adapt to.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour.illuminants import Illuminant
from impasto.colour.observers import (
    STANDARD_OBSERVER,
    White,
    checked_white,
    white_of,
    white_point,
)
from impasto.colour.temperature import (
    adapted_temperature,
    checked_degree,
    correlated,
)
from impasto.colour.wavelengths import Floats
from impasto.errors import ArgumentError

Mode: TypeAlias = Literal["planck", "anchored"]

CONES_FROM_XYZ: Floats = np.array(
    [
        [0.40024, 0.70760, -0.08081],
        [-0.22630, 1.16532, 0.04570],
        [0.0, 0.0, 0.91822],
    ]
)
"""M of eq. 9: Hunt-Pointer-Estevez, scaled so that D65 gives (1, 1, 1)."""
CONES_FROM_XYZ.setflags(write=False)


@dataclass(frozen=True)
class Adaptation:
    """The colours of a painting under the test light as an incompletely adapted eye sees them.

    Attributes
    ----------
    matrix
        ``(3, 3)`` XYZ under the test light to the XYZ that is seen: M^-1 W M of eq. 12.
    d
        Degree of adaptation.
    mode
        ``"planck"`` or ``"anchored"``.
    test_temperature, adapted_temperature, reference_temperature
        Kelvin; the middle one is T_D of eq. 7.
    test_white, adapted_white
        XYZ ``(3,)``, Y = 1: the two whites of eq. 10.
    """

    matrix: Floats
    d: float
    mode: Mode
    test_temperature: float
    adapted_temperature: float
    reference_temperature: float
    test_white: Floats
    adapted_white: Floats


def adaptation(
    test: Illuminant | White,
    reference: Illuminant | White = "D65",
    d: float = 0.56,
    mode: Mode = "planck",
    *,
    observer: str = STANDARD_OBSERVER,
) -> Adaptation:
    """Incomplete adaptation between two lights, with all intermediate quantities.

    Parameters
    ----------
    test
        The light the painting hangs in: a name, a temperature or ``(wavelengths, values)``. A
        source that is no blackbody enters eq. 7 with its correlated colour temperature.
    reference
        The light of complete adaptation. Both may also be a :class:`White`.
    d
        Degree of adaptation, 0 to 1; 0.56 is the mean of the paper's fourteen observers.
    mode
        ``"planck"``: as the paper; all whites are blackbodies of the temperatures of eq. 7.
        With D65 as reference d = 1 is then a 6504 K blackbody, 4.6 CIEDE2000 (pinkish) from D65.
        ``"anchored"``: the path from blackbody to blackbody is shifted so that its ends are the
        true whites, W_D = P(T_D) + (1 - d) (W_T - P(T_T)) + d (W_R - P(T_R)). Equal to
        ``"planck"`` where both lights are blackbodies.
    observer
        The observer that integrates the whites.

    Returns
    -------
    Adaptation
        All whites at Y = 1 before eq. 10: raw radiances of eq. 8 would add a large luminance gain.

    Raises
    ------
    ArgumentError
        An unusable light (see :func:`spectrum`), d outside [0, 1], an unknown mode, or a
        source so coloured that no temperature describes it.
    """
    if mode not in get_args(Mode):
        raise ArgumentError(f'mode: expected "planck" or "anchored", found {mode!r}')
    degree = checked_degree(d)
    test_kelvin = correlated(test, observer, "test").temperature
    reference_kelvin = correlated(reference, observer, "reference").temperature
    kelvin = adapted_temperature(test_kelvin, reference_kelvin, degree)
    test_white = white_point(test_kelvin, observer)
    adapted_white = white_point(kelvin, observer)
    if mode == "anchored":
        true_white = white_of(test, observer, "test")
        test_shift = true_white - test_white
        reference_white = white_of(reference, observer, "reference")
        reference_shift = reference_white - white_point(reference_kelvin, observer)
        adapted_white = adapted_white + (1.0 - degree) * test_shift + degree * reference_shift
        test_white = true_white
    return Adaptation(
        matrix=matrix_from_whites(test_white, adapted_white),
        d=degree,
        mode=mode,
        test_temperature=test_kelvin,
        adapted_temperature=kelvin,
        reference_temperature=reference_kelvin,
        test_white=test_white,
        adapted_white=adapted_white,
    )


def adaptation_matrix(
    test: Illuminant | White,
    reference: Illuminant | White = "D65",
    d: float = 0.56,
    mode: Mode = "planck",
    *,
    observer: str = STANDARD_OBSERVER,
) -> Floats:
    """The matrix ``(3, 3)`` of eq. 12, XYZ in the test light to XYZ as seen.

    Parameters and errors are those of :func:`adaptation`, which also returns the temperatures and
    whites behind the matrix.
    """
    return adaptation(test, reference, d, mode, observer=observer).matrix


def matrix_from_whites(source: ArrayLike, target: ArrayLike) -> Floats:
    """Von Kries matrix between two whites: M^-1 W M with the gains of eq. 10 (eq. 11 and 12).

    Parameters
    ----------
    source, target
        XYZ ``(3,)`` of white before and after. Their luminances should be equal; a difference is a
        gain on every colour.

    Returns
    -------
    ndarray
        ``(3, 3)`` float64; the identity, bit for bit, if the whites are equal.

    Raises
    ------
    ArgumentError
        A white without response of some cone, or not three finite numbers.
    """
    before, after = checked_white(source, "source"), checked_white(target, "target")
    if np.array_equal(before, after):
        return np.eye(3)
    cones_before, cones_after = CONES_FROM_XYZ @ before, CONES_FROM_XYZ @ after
    for name, cones in (("source", cones_before), ("target", cones_after)):
        if (cones <= 0).any():
            raise ArgumentError(
                f"{name}: cone responses {np.round(cones, 4)} must be positive; "
                "a light without some primary colour is no white to adapt to"
            )
    gains = cones_after / cones_before
    return np.asarray(np.linalg.solve(CONES_FROM_XYZ, gains[:, None] * CONES_FROM_XYZ))
