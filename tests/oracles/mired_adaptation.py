"""Eq. 7 to 12 of the six-band paper, in plain float64 from the printed formulas.

Independent of impasto: colour-matching functions come from colour-science, everything else from
the paper (`tominaga-six-band-adaptation`). Run it to print the table of T_D and whites.
"""

from __future__ import annotations

import sys

import colour
import numpy as np

C1, C2 = 3.7418e-16, 1.4388e-2
M = np.array([[0.40024, 0.70760, -0.08081], [-0.22630, 1.16532, 0.04570], [0.0, 0.0, 0.91822]])


def adapted_kelvin(test: float, reference: float, d: float) -> float:
    """Eq. 7."""
    return 1e6 / ((1e6 / reference - 1e6 / test) * d + 1e6 / test)


def white(kelvin: float) -> np.ndarray:
    """XYZ of eq. 8 integrated at 1 nm with the CIE 1931 observer, Y = 1."""
    functions = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    metres = functions.wavelengths * 1e-9
    power = C1 * metres**-5 / (np.exp(C2 / (metres * kelvin)) - 1.0)
    xyz = power @ functions.values
    return xyz / xyz[1]


def matrix(test: np.ndarray, adapted: np.ndarray) -> np.ndarray:
    """Eq. 9 to 12."""
    gains = np.diag((M @ adapted) / (M @ test))
    return np.linalg.inv(M) @ gains @ M


if __name__ == "__main__":
    for d in (0.0, 0.25, 0.5, 0.56, 0.75, 1.0):
        kelvin = adapted_kelvin(2856.0, 6504.0, d)
        xyz = np.round(white(kelvin), 4)
        sys.stdout.write(f"d = {d:.2f}  T_D = {kelvin:7.1f} K  XYZ = {xyz}\n")
