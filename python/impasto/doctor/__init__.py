"""Check a stack before a fit: what is wrong with it, and how to repair each fault.

>>> from impasto import doctor, simulate
>>> stack = simulate.default_capture(size=(64, 64)).stack
>>> doctor.examine(stack).worst
'ok'
"""

from impasto.doctor.before_fit import before_fit
from impasto.doctor.diagnosis import SEVERITIES, Diagnosis, Finding, Severity
from impasto.doctor.examination import examine
from impasto.doctor.files import damaged_files
from impasto.doctor.maps import examine_result
from impasto.doctor.repair import kept_observations, repaired_directions

__all__ = [
    "SEVERITIES",
    "Diagnosis",
    "Finding",
    "Severity",
    "before_fit",
    "damaged_files",
    "examine",
    "examine_result",
    "kept_observations",
    "repaired_directions",
]
