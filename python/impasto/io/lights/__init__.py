"""Light files: directions or positions of the lamps, one reader for every format."""

from impasto.io.lights.light_file import LightFile
from impasto.io.lights.read import LIGHT_SUFFIXES, read_lights
from impasto.io.lights.write import RELIGHT_LIMIT, write_lights

__all__ = ["LIGHT_SUFFIXES", "RELIGHT_LIMIT", "LightFile", "read_lights", "write_lights"]
