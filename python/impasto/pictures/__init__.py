"""Pictures of result maps for viewing; for data, use the maps.

Every map becomes 8-bit RGB ``(y, x, 3)``: normals as (n + 1) / 2, colours with the sRGB curve,
quantities on one perceptual colour ramp, statuses in flat colours. Pixels whose value is unknown
(NaN) show a dark checkerboard. :func:`contact_sheet` arranges such pictures on one sheet, each with
its title and scale.
"""

from impasto.pictures.diagrams import Series, bar_panel, diagram_panel, needle_panel
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
    "Series",
    "bar_panel",
    "colour_panel",
    "colour_ramp",
    "contact_sheet",
    "curve_panel",
    "diagram_panel",
    "fitted",
    "needle_panel",
    "normal_panel",
    "ramp_panel",
    "status_panel",
]
