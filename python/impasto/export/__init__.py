"""A fitted painting in the formats of other programs, each with a report of what it loses.

>>> from impasto import export
>>> report = export.to("gltf", sbrdf, "icon.glb")                 # doctest: +SKIP
>>> report.p95, report.lost                                       # doctest: +SKIP
"""

from impasto.export.formats import FORMATS, Format, to
from impasto.export.loss import LossReport, SceneLoss
from impasto.export.source import Source

__all__ = ["FORMATS", "Format", "LossReport", "SceneLoss", "Source", "to"]
