"""Pictures of result maps, for looking at: not data.

Every map becomes 8-bit RGB ``(y, x, 3)``: normals as (n + 1) / 2, colours through the sRGB curve,
quantities on one perceptual ramp, statuses in flat colours. Pixels whose value is unknown (NaN)
show a dark checkerboard. :func:`contact_sheet` sets such pictures side by side, each with its name
and its scale.
"""

from impasto.pictures.panels import (
    BACKGROUND,
    FAINT,
    INK,
    STATUS_COLOURS,
    Panel,
    Picture,
    colour_panel,
    colour_ramp,
    curve_panel,
    normal_panel,
    ramp_panel,
    status_panel,
)
from impasto.pictures.sheet import contact_sheet, fitted

__all__ = [
    "BACKGROUND",
    "FAINT",
    "INK",
    "STATUS_COLOURS",
    "Panel",
    "Picture",
    "colour_panel",
    "colour_ramp",
    "contact_sheet",
    "curve_panel",
    "fitted",
    "normal_panel",
    "ramp_panel",
    "status_panel",
]
