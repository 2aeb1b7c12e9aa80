"""Alignment: photographs rectified to the frontal view of a painting, pixel for pixel."""

from impasto.align.card import Card
from impasto.align.depth_picture import depth_picture
from impasto.align.depth_search import FoundDepth, find_depth
from impasto.align.detection import FoundMarks, find_marks
from impasto.align.features import Reference, read_reference
from impasto.align.frontal import frontal_view
from impasto.align.layout import Layout, layout_from_markers, read_points, size_from
from impasto.align.pose import Pose, camera_pose, camera_poses
from impasto.align.refinement import Shift, shift_between
from impasto.align.relighting import relit_shifts
from impasto.align.report import Aligned, AlignedPhotograph
from impasto.align.stack import align
from impasto.depth_mesh import DepthMesh, Parallax
from impasto.frontal_view import FrontalView
from impasto.io.depth_mesh import read_depth, write_depth
from impasto.rectification import Grid, Rectified, rectified, rectified_rows

__all__ = [
    "Aligned",
    "AlignedPhotograph",
    "Card",
    "DepthMesh",
    "FoundDepth",
    "FoundMarks",
    "FrontalView",
    "Grid",
    "Layout",
    "Parallax",
    "Pose",
    "Rectified",
    "Reference",
    "Shift",
    "align",
    "camera_pose",
    "camera_poses",
    "depth_picture",
    "find_depth",
    "find_marks",
    "frontal_view",
    "layout_from_markers",
    "read_depth",
    "read_points",
    "read_reference",
    "rectified",
    "rectified_rows",
    "relit_shifts",
    "shift_between",
    "size_from",
    "write_depth",
]
