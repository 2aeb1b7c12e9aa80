"""From light to colour: spectra to XYZ, chromatic adaptation, and displays.

Everything here is small, float64 and linear up to the display's tone curves, so a whole scene
folds into one matrix that the renderer applies per pixel (:func:`display_from_coefficients`).
colour-science supplies the tables and is imported when the first of them is needed.
"""

from impasto.colour.adaptation import (
    CONES_FROM_XYZ,
    Adaptation,
    adaptation,
    adaptation_matrix,
    matrix_from_whites,
)
from impasto.colour.astm import xyz_from_spectrum_astm
from impasto.colour.difference import delta_e, lab_from_xyz
from impasto.colour.display import Calibration, Display
from impasto.colour.fold import (
    Fold,
    WhiteScale,
    XyzFold,
    display_from_coefficients,
    display_from_xyz,
    white_scale,
    xyz_from_coefficients,
)
from impasto.colour.icc import icc_profile
from impasto.colour.illuminants import Illuminant, illuminant_names, planck, spectrum
from impasto.colour.observers import (
    OBSERVERS,
    STANDARD_OBSERVER,
    White,
    white_point,
    xyz_from_spectrum,
)
from impasto.colour.session import as_display, read_display
from impasto.colour.temperature import Correlated, adapted_temperature, correlated_temperature
from impasto.colour.wavelengths import interpolation_matrix

__all__ = [
    "CONES_FROM_XYZ",
    "OBSERVERS",
    "STANDARD_OBSERVER",
    "Adaptation",
    "Calibration",
    "Correlated",
    "Display",
    "Fold",
    "Illuminant",
    "White",
    "WhiteScale",
    "XyzFold",
    "adaptation",
    "adaptation_matrix",
    "adapted_temperature",
    "as_display",
    "correlated_temperature",
    "delta_e",
    "display_from_coefficients",
    "display_from_xyz",
    "icc_profile",
    "illuminant_names",
    "interpolation_matrix",
    "lab_from_xyz",
    "matrix_from_whites",
    "planck",
    "read_display",
    "spectrum",
    "white_point",
    "white_scale",
    "xyz_from_coefficients",
    "xyz_from_spectrum",
    "xyz_from_spectrum_astm",
]
