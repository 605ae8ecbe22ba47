"""Universal Robots URScript."""

from irbcal.correction.languages.urscript.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.urscript.writing import UNIVERSAL_ROBOTS

NAME = "URScript"
ENDINGS = (".script", ".urscript")
MAKER = UNIVERSAL_ROBOTS

__all__ = ["ENDINGS", "MAKER", "NAME", "fingerprint", "looks_like", "read_for"]
