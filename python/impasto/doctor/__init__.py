"""Check a stack before it is used: what is wrong with it, and what to do about each fault.

>>> from impasto import doctor, simulate
>>> stack = simulate.default_capture(size=(64, 64)).stack
>>> doctor.examine(stack).worst
'ok'
"""

from impasto.doctor.diagnosis import SEVERITIES, Diagnosis, Finding, Severity
from impasto.doctor.examination import examine
from impasto.doctor.files import damaged_files
from impasto.doctor.repair import repaired_directions

__all__ = [
    "SEVERITIES",
    "Diagnosis",
    "Finding",
    "Severity",
    "damaged_files",
    "examine",
    "repaired_directions",
]
