"""The Wiener estimate as somebody writes it in numpy: the peer of the reflectance estimators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.colour.wavelengths import Floats
from impasto.training import general_training
from study.pigments import GRID, NOISE, PigmentPhotograph

NAME = "wiener, numpy"


@dataclass(frozen=True, eq=False)
class Product:
    """Coefficients ``(k, 1, pixel)`` float32 of basis spectra ``(k, 31)``."""

    coefficients: NDArray[np.float32]
    basis: Floats


def fit(photograph: PigmentPhotograph, threads: int | None) -> Product:
    """Eq. 5 of Tominaga and Tanaka's six-band paper, in float64; applied as one product in float32.

    ``G = R H^T (H R H^T + s^2 I)^-1`` with the correlation R of the training spectra. Its columns
    are written in as many orthonormal spectra as there are bands, so that a pixel costs a product
    of that size, as ours does. numpy has its own threads.
    """
    del threads
    training = general_training().at(GRID)
    correlation = training.T @ training / len(training)
    seen = photograph.camera.operator(GRID, integration="sum")
    noise = NOISE**2 * np.eye(len(seen))
    matrix = np.linalg.solve(seen @ correlation @ seen.T + noise, seen @ correlation).T
    basis, size, turn = np.linalg.svd(matrix, full_matrices=False)
    apply = (size[:, None] * turn).astype(np.float32)
    bands, height, width = photograph.responses.shape
    product = apply @ photograph.responses.reshape(bands, -1)
    return Product(product.reshape(-1, height, width), basis.T)
