"""The matching experiment of the six-band paper, which measures how far an eye adapts to a lamp.

Observers look at a painting under a lamp, remember it, and choose the picture on a display that
looks most like it, among pictures for several degrees d of incomplete adaptation
[@tominaga-six-band-adaptation].
"""

from impasto.matching.analysis import Matching, analyse
from impasto.matching.experiment import Experiment
from impasto.matching.log import Choice, MatchingLog, read_log
from impasto.matching.models import ModelMatch
from impasto.matching.server import MatchingServer
from impasto.matching.stimuli import Stimuli, stimuli

__all__ = [
    "Choice",
    "Experiment",
    "Matching",
    "MatchingLog",
    "MatchingServer",
    "ModelMatch",
    "Stimuli",
    "analyse",
    "read_log",
    "stimuli",
]
