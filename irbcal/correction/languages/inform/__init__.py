"""Yaskawa INFORM jobs."""

from irbcal.correction.languages.inform.moves import write_moves
from irbcal.correction.languages.inform.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.inform.writing import YASKAWA

NAME = "Yaskawa INFORM"
ENDINGS = (".jbi",)
ROBOTS = r"motoman|yaskawa|(^|_)(gp|hc|mh|ma|ms)\d"
MAKER = YASKAWA

__all__ = ["ENDINGS", "MAKER", "NAME", "ROBOTS", "fingerprint", "looks_like", "read_for", "write_moves"]
