"""Check a stack before it is used: what is wrong with it, and what to do about each fault.

>>> from impasto import doctor, simulate
>>> stack = simulate.default_capture(size=(64, 64)).stack
>>> doctor.examine(stack).worst
'ok'
"""

from impasto.doctor.diagnosis import SEVERITIES, Diagnosis, Finding, Severity
from impasto.doctor.examination import examine

__all__ = ["SEVERITIES", "Diagnosis", "Finding", "Severity", "examine"]
