"""Files in, files out: photographs, light files, maps."""

from impasto.io.archive import write_stack
from impasto.io.cameras import read_camera, write_camera
from impasto.io.files import atomic_bytes, atomic_path
from impasto.io.headers import ImageHeader, read_header
from impasto.io.images import read_image
from impasto.io.labels import read_labels
from impasto.io.lights import LightFile, read_lights
from impasto.io.lp import write_lights
from impasto.io.notes import Note
from impasto.io.reader import read_stack
from impasto.io.tone import ToneEstimate, estimate_tone
from impasto.io.write import (
    write_exr,
    write_jpeg,
    write_json,
    write_png8,
    write_png16,
    write_tiff16,
    write_tiff32,
)

__all__ = [
    "ImageHeader",
    "LightFile",
    "Note",
    "ToneEstimate",
    "atomic_bytes",
    "atomic_path",
    "estimate_tone",
    "read_camera",
    "read_header",
    "read_image",
    "read_labels",
    "read_lights",
    "read_stack",
    "write_camera",
    "write_exr",
    "write_jpeg",
    "write_json",
    "write_lights",
    "write_png8",
    "write_png16",
    "write_stack",
    "write_tiff16",
    "write_tiff32",
]
