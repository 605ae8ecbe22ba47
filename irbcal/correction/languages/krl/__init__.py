"""KUKA KRL."""

from irbcal.correction.languages.krl.moves import write_moves
from irbcal.correction.languages.krl.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.krl.writing import KUKA

NAME = "KUKA KRL"
ENDINGS = (".src", ".dat", ".sub")
ROBOTS = r"kuka|(^|_)k[ru]\d"
MAKER = KUKA

__all__ = ["ENDINGS", "MAKER", "NAME", "ROBOTS", "fingerprint", "looks_like", "read_for", "write_moves"]
