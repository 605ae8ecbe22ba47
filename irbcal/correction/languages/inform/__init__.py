"""Yaskawa INFORM jobs."""

from irbcal.correction.languages.inform.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.inform.writing import YASKAWA

NAME = "Yaskawa INFORM"
ENDINGS = (".jbi",)
MAKER = YASKAWA

__all__ = ["ENDINGS", "MAKER", "NAME", "fingerprint", "looks_like", "read_for"]
