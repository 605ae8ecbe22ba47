"""Universal Robots URScript."""

from irbcal.correction.languages.urscript.moves import write_moves
from irbcal.correction.languages.urscript.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.urscript.writing import UNIVERSAL_ROBOTS

NAME = "URScript"
ENDINGS = (".script", ".urscript")
ROBOTS = r"universal_?robot|(^|_)ur\d+e?(_|$)"
MAKER = UNIVERSAL_ROBOTS

__all__ = ["ENDINGS", "MAKER", "NAME", "ROBOTS", "fingerprint", "looks_like", "read_for", "write_moves"]
