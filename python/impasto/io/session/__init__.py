"""A session of photographs, its lights and calibration frames: files into a stack, and back."""

from impasto.io.session.archive import write_stack
from impasto.io.session.reader import read_stack
from impasto.io.session.tone import ToneEstimate, estimate_tone

__all__ = ["ToneEstimate", "estimate_tone", "read_stack", "write_stack"]
