"""The build of impasto that a result is of: its version, and a digest of its code."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from impasto import _core


@cache
def build_name() -> str:
    """Version and digest of the code, as ``0.1.0+3f2a9c04d1b7``.

    Two builds of one version, as between two releases, need not give the same bytes. The digest is
    of the sources in Python and Rust, not of what a compiler has made of them: machines with other
    processors agree on it.
    """
    info = _core.build_info()
    digest = hashlib.sha256(info["sources"].encode())
    package = Path(__file__).resolve().parents[1]
    for path in sorted(package.rglob("[!.]*.py")):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(path.read_bytes())
    return f"{info['version']}+{digest.hexdigest()[:12]}"
