"""Fits of any size: tile by tile, in a given memory, resumable after anything."""

from impasto.jobs.ingest import ingest
from impasto.jobs.inspection import Finding, JobStatus, status, verify
from impasto.jobs.job import run
from impasto.jobs.repeat import rerun, resume

__all__ = ["Finding", "JobStatus", "ingest", "rerun", "resume", "run", "status", "verify"]
