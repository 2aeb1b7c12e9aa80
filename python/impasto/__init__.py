"""Photographs of a painting in; a relightable, colour-true surface out."""

from impasto.encoding import Encoding
from impasto.errors import (
    ArgumentError,
    CorruptInputError,
    GeometryError,
    ImpastoError,
    InternalError,
)
from impasto.rig import DistantLight, PointLight, Rig
from impasto.stack import Stack
from impasto.status import Status

__all__ = [
    "ArgumentError",
    "CorruptInputError",
    "DistantLight",
    "Encoding",
    "GeometryError",
    "ImpastoError",
    "InternalError",
    "PointLight",
    "Rig",
    "Stack",
    "Status",
]
