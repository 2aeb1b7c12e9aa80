"""The command line: ``impasto demo | fit | render | doctor | info``.

Data goes to stdout or into files, progress to stderr. Angles are in degrees. Exit codes:

====  ==========================================================
0     done
1     the input or an argument's value cannot be used
2     the command line itself is wrong
3     a file is truncated or damaged
4     the result is partial
70    a defect in impasto itself
130   interrupted
====  ==========================================================
"""

from impasto.cli.application import main

__all__ = ["main"]
