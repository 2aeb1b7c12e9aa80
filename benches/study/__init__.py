"""The recorded study: what accuracy costs in time, on fixed data and beside other programs.

``python benches/study`` is the command. :func:`run` measures, :func:`write` writes. The study of
one's own photographs is :mod:`impasto.study`.
"""

from study.report import write
from study.sweep import run

__all__ = ["run", "write"]
