"""Read and write photographs, light files and maps."""

from impasto.io.cameras import read_camera, write_camera
from impasto.io.files import atomic_bytes, atomic_path
from impasto.io.images import ImageHeader, read_header, read_image
from impasto.io.images.write import (
    write_exr,
    write_jpeg,
    write_json,
    write_png8,
    write_png16,
    write_tiff16,
    write_tiff32,
)
from impasto.io.labels import read_labels
from impasto.io.lights import LightFile, read_lights
from impasto.io.lights.write import write_lights
from impasto.io.notes import Note
from impasto.io.opening import open_source
from impasto.io.rti import RelightableImage, read_relightable
from impasto.io.session.archive import write_stack
from impasto.io.session.reader import read_stack
from impasto.io.session.tone import ToneEstimate, estimate_tone
from impasto.io.session_toml import Session, read_session, write_session
from impasto.io.sources import Source
from impasto.io.spectra import read_spectra
from impasto.io.tone_curve import read_tone_curve, write_tone_curve

__all__ = [
    "ImageHeader",
    "LightFile",
    "Note",
    "RelightableImage",
    "Session",
    "Source",
    "ToneEstimate",
    "atomic_bytes",
    "atomic_path",
    "estimate_tone",
    "open_source",
    "read_camera",
    "read_header",
    "read_image",
    "read_labels",
    "read_lights",
    "read_relightable",
    "read_session",
    "read_spectra",
    "read_stack",
    "read_tone_curve",
    "write_camera",
    "write_exr",
    "write_jpeg",
    "write_json",
    "write_lights",
    "write_png8",
    "write_png16",
    "write_session",
    "write_stack",
    "write_tiff16",
    "write_tiff32",
    "write_tone_curve",
]
