"""A session of photographs: what lies in a folder, and whether it still is what was photographed.

``impasto.io`` reads and writes ``session.toml``; here it is made from a folder, and checked.
"""

from impasto.session.check import DAMAGED, check_session
from impasto.session.inventory import FoundSession, find_session
from impasto.session.sequence import longest_increasing, sequence

__all__ = [
    "DAMAGED",
    "FoundSession",
    "check_session",
    "find_session",
    "longest_increasing",
    "sequence",
]
