"""Picture files: one module per format; structures are checked to the end before decoding."""

from impasto.io.images.header import MAX_PIXELS, ImageHeader
from impasto.io.images.read import (
    IMAGE_SUFFIXES,
    list_images,
    load_image,
    natural_key,
    open_picture,
    photographs_below,
    photographs_in,
    read_header,
    read_image,
)
from impasto.io.images.write import (
    write_exr,
    write_jpeg,
    write_png8,
    write_png16,
    write_tiff16,
    write_tiff32,
)

__all__ = [
    "IMAGE_SUFFIXES",
    "MAX_PIXELS",
    "ImageHeader",
    "list_images",
    "load_image",
    "natural_key",
    "open_picture",
    "photographs_below",
    "photographs_in",
    "read_header",
    "read_image",
    "write_exr",
    "write_jpeg",
    "write_png8",
    "write_png16",
    "write_tiff16",
    "write_tiff32",
]
