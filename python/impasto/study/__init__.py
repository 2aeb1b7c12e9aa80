"""What accuracy costs in time: settings swept over fixed data.

``impasto study`` is this package's command. :func:`run` measures, :func:`write` writes.
"""

from impasto.study.sweep import run
from impasto.study.write import write

__all__ = ["run", "write"]
