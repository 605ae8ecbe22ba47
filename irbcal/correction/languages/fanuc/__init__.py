"""FANUC teach pendant programs as text."""

from irbcal.correction.languages.fanuc.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.fanuc.writing import FANUC

NAME = "FANUC LS"
ENDINGS = (".ls",)
MAKER = FANUC

__all__ = ["ENDINGS", "MAKER", "NAME", "fingerprint", "looks_like", "read_for"]
