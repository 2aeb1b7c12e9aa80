"""Fits of any size: tile by tile, in a given memory, resumable after anything."""

from impasto.jobs.grid import Footprint
from impasto.jobs.ingest import ingest
from impasto.jobs.job import run
from impasto.jobs.job_status import JobStatus, status
from impasto.jobs.photographs import Photographs
from impasto.jobs.repeat import rerun, resume
from impasto.jobs.ro_crate import export_ro_crate
from impasto.jobs.verification import Finding, verify

__all__ = [
    "Finding",
    "Footprint",
    "JobStatus",
    "Photographs",
    "export_ro_crate",
    "ingest",
    "rerun",
    "resume",
    "run",
    "status",
    "verify",
]
