"""KUKA KRL."""

from irbcal.correction.languages.krl.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.krl.writing import KUKA

NAME = "KUKA KRL"
ENDINGS = (".src", ".dat", ".sub")
MAKER = KUKA

__all__ = ["ENDINGS", "MAKER", "NAME", "fingerprint", "looks_like", "read_for"]
