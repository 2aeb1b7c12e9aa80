"""ICC profiles: embedded in picture files, so that other programs show the right colours.

A picture for sRGB is mostly understood without one, but not by programs that take codes without a
profile for those of the monitor; a picture for any other display is not.
"""

from __future__ import annotations

import struct

import numpy as np

from impasto.colour.curves import Curve, GammaCurve, SrgbCurve
from impasto.colour.display import Display
from impasto.colour.wavelengths import Floats

D50 = np.array([0.9642, 1.0, 0.8249])
"""White of the profile connection space, from ICC.1:2022."""
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
"""Cones of the chromatic adaptation that ICC.1:2022, annex E, recommends."""
ENTRIES = 4096
"""Of a tabulated curve; the format allows 16 bits each."""
SRGB_PARAMETERS = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
"""g, a, b, c, d of ICC's parametric curve 3: ((a x + b)^g above d, c x below)."""


def icc_profile(display: Display) -> bytes:
    """An ICC profile (version 4, matrix and curves) of a display.

    Parameters
    ----------
    display
        Standard or calibrated. Its black is in the curves.

    Returns
    -------
    bytes
        To embed in PNG, TIFF or JPEG. The same display gives the same bytes.
    """
    white = display.xyz_from_linear.sum(axis=1)
    adapt = np.linalg.solve(BRADFORD, ((BRADFORD @ D50) / (BRADFORD @ white))[:, None] * BRADFORD)
    colorants = adapt @ display.xyz_from_linear
    tags = {
        b"desc": _text(f"impasto {display.name}"),
        b"cprt": _text("No copyright, use freely"),
        b"wtpt": _xyz(D50),
        b"chad": b"sf32" + bytes(4) + _fixed(adapt),
    }
    for index, channel in enumerate((b"r", b"g", b"b")):
        tags[channel + b"XYZ"] = _xyz(colorants[:, index])
        tags[channel + b"TRC"] = _curve(
            display.curve.channels[index], float(display.curve.floor[index])
        )
    return _assembled(tags)


def _assembled(tags: dict[bytes, bytes]) -> bytes:
    table, data = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for signature, content in tags.items():
        table += signature + struct.pack(">II", start + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    size = start + len(data)
    header = struct.pack(
        ">I4sI4s4s4s6H4s4sI4sI8sI12s4s16s28s",
        size,
        bytes(4),
        0x04400000,
        b"mntr",
        b"RGB ",
        b"XYZ ",
        # A fixed date: the same display gives the same bytes.
        *(2000, 1, 1, 0, 0, 0),
        b"acsp",
        bytes(4),
        0,
        bytes(4),
        0,
        bytes(8),
        1,
        _fixed(D50),
        bytes(4),
        bytes(16),
        bytes(28),
    )
    return header + struct.pack(">I", len(tags)) + table + data


def _curve(curve: Curve, floor: float) -> bytes:
    if floor == 0.0 and isinstance(curve, SrgbCurve):
        return b"para" + bytes(4) + struct.pack(">HH", 3, 0) + _fixed(np.array(SRGB_PARAMETERS))
    if floor == 0.0 and isinstance(curve, GammaCurve):
        return b"para" + bytes(4) + struct.pack(">HH", 0, 0) + _fixed(np.array([curve.gamma]))
    light = floor + (1.0 - floor) * curve.decode(np.linspace(0.0, 1.0, ENTRIES))
    # A floor below zero is a black outside the primaries' triangle: the format ends at 0.
    values = np.rint(65535.0 * np.clip(light, 0.0, 1.0)).astype(">u2")
    return b"curv" + bytes(4) + struct.pack(">I", ENTRIES) + values.tobytes()


def _text(text: str) -> bytes:
    data = text.encode("utf-16-be")
    return b"mluc" + bytes(4) + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(data), 28) + data


def _xyz(values: Floats) -> bytes:
    return b"XYZ " + bytes(4) + _fixed(values)


def _fixed(values: Floats) -> bytes:
    """s15Fixed16 numbers, rows first."""
    return np.rint(np.asarray(values) * 65536.0).astype(">i4").tobytes()
