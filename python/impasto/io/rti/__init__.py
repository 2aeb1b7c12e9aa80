"""Reflectance transformation imaging: ``.ptm``, ``.rti`` and relight's folders."""

from impasto.io.rti.bases import Basis
from impasto.io.rti.image import RelightableImage
from impasto.io.rti.ptm import read_ptm, write_ptm
from impasto.io.rti.quantise import quantised
from impasto.io.rti.read import is_relightable, read_relightable
from impasto.io.rti.relight_folder import read_relight, write_relight
from impasto.io.rti.universal import read_rti, write_rti

__all__ = [
    "Basis",
    "RelightableImage",
    "is_relightable",
    "quantised",
    "read_ptm",
    "read_relight",
    "read_relightable",
    "read_rti",
    "write_ptm",
    "write_relight",
    "write_rti",
]
