"""Simulated sessions, from raw photographs to the relit picture, against the truth."""
