"""Fits of any size: tile by tile, in a given memory, resumable after anything."""

from impasto.jobs.run import run

__all__ = ["run"]
