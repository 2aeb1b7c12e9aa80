"""Overlapping frames of one painting: registration, colours, levels, and one result of all."""

from impasto.merge.merging import Merged, merge
from impasto.merge.report import FrameReport, MergeReport, SeamReport

__all__ = ["FrameReport", "MergeReport", "Merged", "SeamReport", "merge"]
