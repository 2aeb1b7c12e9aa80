"""A local page in the browser that edits marks, outlines of mirror balls and depth meshes.

What a detector found can be corrected by hand: the page reads and writes the files that
``impasto align`` and ``impasto calibrate lights`` take.
"""

from impasto.editing.balls import BallOutlines
from impasto.editing.marks import Marks
from impasto.editing.mesh import Mesh
from impasto.editing.server import EditServer
from impasto.local_page import Subject

__all__ = ["BallOutlines", "EditServer", "Marks", "Mesh", "Subject"]
