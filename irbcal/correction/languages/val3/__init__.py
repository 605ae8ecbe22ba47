"""Staubli VAL3."""

from irbcal.correction.languages.val3.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.val3.writing import STAUBLI

NAME = "VAL3"
ENDINGS = (".dtx", ".pgx", ".pjx")
MAKER = STAUBLI

__all__ = ["ENDINGS", "MAKER", "NAME", "fingerprint", "looks_like", "read_for"]
