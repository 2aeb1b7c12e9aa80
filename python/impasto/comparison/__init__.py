"""What changed between two states of a painting: registration, maps, significance, a table.

The two are results of :func:`impasto.fit_sbrdf`, such as before and after cleaning.
"""

from impasto.comparison.comparing import compare, load_comparison
from impasto.comparison.entries import (
    Area,
    Changed,
    Cluster,
    ClusterExtent,
    Compared,
    ComparisonMaps,
    GlossChange,
    Quantity,
    Registration,
)
from impasto.comparison.result import Comparison

__all__ = [
    "Area",
    "Changed",
    "Cluster",
    "ClusterExtent",
    "Compared",
    "Comparison",
    "ComparisonMaps",
    "GlossChange",
    "Quantity",
    "Registration",
    "compare",
    "load_comparison",
]
