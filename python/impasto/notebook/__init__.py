"""What notebooks show of stacks, results, plans and comparisons; imported when one is shown."""

from impasto.notebook.views import (
    comparison_view,
    decisions_view,
    normals_view,
    reflectance_view,
    relightable_view,
    sbrdf_view,
    stack_view,
    stored_view,
)

__all__ = [
    "comparison_view",
    "decisions_view",
    "normals_view",
    "reflectance_view",
    "relightable_view",
    "sbrdf_view",
    "stack_view",
    "stored_view",
]
