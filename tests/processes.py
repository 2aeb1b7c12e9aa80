"""Python programs in a process of their own, for what a process settles once: instruction sets."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import impasto

HERE = Path(__file__).parent


def surroundings(**variables: str) -> dict[str, str]:
    """The environment of a process that imports this impasto and what stands beside the tests."""
    package = Path(impasto.__file__).parents[1]
    return os.environ | {"PYTHONPATH": f"{HERE}{os.pathsep}{package}"} | variables


def run(program: str, *arguments: str, **variables: str) -> str:
    """What a Python program prints."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env=surroundings(**variables),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
