"""Spectra of metals from published optical constants, in plain float64 numpy.

Gold, silver and copper: P. B. Johnson and R. W. Christy, Optical constants of the noble metals,
Phys. Rev. B 6, 4370 (1972). Brass (70 % copper, 30 % zinc): M. R. Querry, Optical constants,
Contractor Report CRDC-CR-85034 (1985). Both as tabulated in the refractiveindex.info database
(CC0): wavelength in nm, n, k.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_NOBLE = (397.4, 413.3, 430.5, 450.9, 471.4, 495.9, 520.9, 548.6, 582.1, 616.8, 659.5, 704.5, 756.0)
_BRASS = tuple(float(nm) for nm in range(380, 761, 20))

CONSTANTS = {
    "gold": (
        _NOBLE,
        (1.47, 1.46, 1.45, 1.38, 1.31, 1.04, 0.62, 0.43, 0.29, 0.21, 0.14, 0.13, 0.14),
        (
            *(1.952, 1.958, 1.948, 1.914, 1.849, 1.833, 2.081, 2.455, 2.863, 3.272, 3.697),
            *(4.103, 4.542),
        ),
    ),
    "silver": (
        _NOBLE,
        (0.05, 0.05, 0.04, 0.04, 0.05, 0.05, 0.05, 0.06, 0.05, 0.06, 0.05, 0.04, 0.03),
        (
            *(2.070, 2.275, 2.462, 2.657, 2.869, 3.093, 3.324, 3.586, 3.858, 4.152, 4.483),
            *(4.838, 5.242),
        ),
    ),
    "copper": (
        _NOBLE,
        (1.32, 1.28, 1.25, 1.24, 1.25, 1.22, 1.18, 1.02, 0.70, 0.30, 0.22, 0.21, 0.24),
        (
            *(2.116, 2.207, 2.305, 2.397, 2.483, 2.564, 2.608, 2.577, 2.704, 3.205, 3.747),
            *(4.205, 4.665),
        ),
    ),
    "brass": (
        _BRASS,
        (
            *(1.487, 1.445, 1.350, 1.191, 0.994, 0.816, 0.686, 0.602, 0.549, 0.505, 0.468),
            *(0.450, 0.449, 0.444, 0.445, 0.444, 0.446, 0.450, 0.455, 0.458),
        ),
        (
            *(1.818, 1.805, 1.786, 1.797, 1.883, 2.046, 2.250, 2.464, 2.668, 2.860, 3.059),
            *(3.253, 3.434, 3.609, 3.778, 3.943, 4.106, 4.266, 4.424, 4.579),
        ),
    ),
}


def reflectance(metal: str, wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fresnel reflectance at normal incidence: ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2)."""
    at, real, imaginary = CONSTANTS[metal]
    n, k = (np.interp(wavelengths, at, values) for values in (real, imaginary))
    found: NDArray[np.float64] = ((n - 1.0) ** 2 + k**2) / ((n + 1.0) ** 2 + k**2)
    return found
