"""Lamps without a mirror ball: uncalibrated photometric stereo, which says when it cannot."""

from impasto.calibrate.uncalibrated.estimate import lights_from_panel
from impasto.calibrate.uncalibrated.patches import Patches, patches_of, read_patches
from impasto.calibrate.uncalibrated.picture import panel_lights_picture
from impasto.calibrate.uncalibrated.result import PanelLights

__all__ = [
    "PanelLights",
    "Patches",
    "lights_from_panel",
    "panel_lights_picture",
    "patches_of",
    "read_patches",
]
