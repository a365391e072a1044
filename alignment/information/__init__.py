"""What a procedure can tell, before there are readings: Fisher information of it.

`information` takes the stretches a table will give (`Stretch`), the instrument's own
(`InstrumentErrors`) and what is known of the table (`Setting`), and answers with predicted sigmas,
their contributions, the rank of what the readings alone determine, and in words what they cannot
tell apart.
"""

from alignment.information.drift import GaussMarkov
from alignment.information.model import InstrumentErrors, Setting, Stretch, TriadErrors, assumed
from alignment.information.result import ANGLES, Information, information
from alignment.information.words import Combination

__all__ = [
    "ANGLES",
    "Combination",
    "GaussMarkov",
    "Information",
    "InstrumentErrors",
    "Setting",
    "Stretch",
    "TriadErrors",
    "assumed",
    "information",
]
