"""The packaged training spectra: cluster centres of measured pigments.

    python benches/python/training_centres.py [--data DIR] [--write]

Ward's method [@ward1963hierarchical] merges, again and again, the two clusters whose union adds
least to the sum of squares about the means; it starts from no random number. The spectra are those
of HypPigments (Deborah, WHISPERS 2022, CC BY 4.0); ``python/impasto/data/ATTRIBUTION.md`` says what
becomes of them. Without ``--write`` the packaged file is compared with what comes out.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from record import data_folder
from scipy.cluster.hierarchy import fcluster, linkage

from impasto.training import PIGMENTS
from study import pigments

GRID = np.arange(400.0, 781.0, 10.0)
COUNT = 768
ONE = 65535
"""A perfect white in the file."""


def spectra_of(folder: Path) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Spectra ``(1586, 39)`` on :data:`GRID`, and the number of each one's pigment."""
    file = np.load(folder / pigments.PIGMENTS)
    wavelength = file["wavelength"].astype(np.float64)
    visible = (wavelength >= 400) & (wavelength <= 720)
    keep = file["reflectance"][:, visible].max(axis=1) <= 1
    rows = file["reflectance"][keep].astype(np.float64)
    return np.array([np.interp(GRID, wavelength, row) for row in rows]), file["kremer"][keep]


def centres(spectra: NDArray[np.float64], count: int = COUNT) -> NDArray[np.float64]:
    """Means of ``count`` clusters, darkest first."""
    cluster = fcluster(linkage(spectra, "ward"), count, "maxclust")
    means = np.array([spectra[cluster == each].mean(axis=0) for each in np.unique(cluster)])
    return means[np.argsort(means.sum(axis=1), kind="stable")]


def packaged(spectra: NDArray[np.float64]) -> dict[str, NDArray[np.uint16]]:
    """The arrays of the file."""
    return {
        "wavelengths": GRID.astype(np.uint16),
        "reflectance": np.round(centres(spectra) * ONE).astype(np.uint16),
        "one": np.array(ONE, np.uint16),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    arrays = packaged(spectra_of(options.data)[0])
    if options.write:
        np.savez_compressed(PIGMENTS, **arrays)
        print(f"{PIGMENTS}: {PIGMENTS.stat().st_size} bytes")
        return
    with np.load(PIGMENTS) as file:
        off = np.abs(file["reflectance"].astype(int) - arrays["reflectance"].astype(int)).max()
    print(f"largest difference from the packaged file: {off} of {ONE}")


if __name__ == "__main__":
    main()
