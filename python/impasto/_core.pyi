"""The numerics of impasto: what the Rust extension offers to the package, and to nobody else.

Arrays are C-contiguous; shapes and units stand in the public functions that call these.
"""

from typing import TypedDict, type_check_only

@type_check_only
class BuildInfo(TypedDict):
    version: str
    debug: bool
    simd: str

STATUS: list[tuple[str, int]]

def build_info() -> BuildInfo: ...
