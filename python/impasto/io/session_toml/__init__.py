"""``session.toml``: what belongs to the photographs of one painting, in one file for people.

This folder knows the file alone: keys, values, hashes, places. ``impasto.io.session``, which reads
stacks, imports it; ``impasto.session``, which makes and checks such files by EXIF, light files and
findings of the doctor, imports both. So no folder imports one that imports it.
"""

from impasto.io.session_toml.hashes import Problem, sha256_of, verify
from impasto.io.session_toml.read import SESSION_FILE, is_session, read_session
from impasto.io.session_toml.schema import KEYS, VERSION, Key, Session
from impasto.io.session_toml.write import session_text, write_session

__all__ = [
    "KEYS",
    "SESSION_FILE",
    "VERSION",
    "Key",
    "Problem",
    "Session",
    "is_session",
    "read_session",
    "session_text",
    "sha256_of",
    "verify",
    "write_session",
]
