"""Staubli VAL3."""

from irbcal.correction.languages.val3.moves import write_moves
from irbcal.correction.languages.val3.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.val3.writing import STAUBLI

NAME = "VAL3"
ENDINGS = (".dtx", ".pgx", ".pjx")
ROBOTS = r"staubli|(^|_)(rx\d|tx2?_?\d)"
MAKER = STAUBLI

__all__ = ["ENDINGS", "MAKER", "NAME", "ROBOTS", "fingerprint", "looks_like", "read_for", "write_moves"]
