"""Photographs of a painting in; a relightable, colour-true surface out."""

import warnings as _warnings

from impasto import _core, colour
from impasto.bands import Camera
from impasto.encoding import Encoding
from impasto.errors import (
    ArgumentError,
    CorruptInputError,
    GeometryError,
    ImpastoError,
    InternalError,
)
from impasto.fit.reflectance import Reflectance, fit_reflectance, white_corrected
from impasto.io import read_stack
from impasto.rig import DistantLight, PointLight, Rig
from impasto.stack import Stack
from impasto.status import Status
from impasto.training import Training

__all__ = [
    "ArgumentError",
    "Camera",
    "CorruptInputError",
    "DistantLight",
    "Encoding",
    "GeometryError",
    "ImpastoError",
    "InternalError",
    "PointLight",
    "Reflectance",
    "Rig",
    "Stack",
    "Status",
    "Training",
    "colour",
    "fit_reflectance",
    "read_stack",
    "white_corrected",
]

__version__ = _core.build_info()["version"]

if _core.build_info()["debug"]:
    _warnings.warn(
        "impasto was built without optimisation and is slow; build it with `make build`",
        RuntimeWarning,
        stacklevel=2,
    )
