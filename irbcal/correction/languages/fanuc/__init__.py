"""FANUC teach pendant programs as text."""

from irbcal.correction.languages.fanuc.moves import write_moves
from irbcal.correction.languages.fanuc.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.fanuc.writing import FANUC

NAME = "FANUC LS"
ENDINGS = (".ls",)
ROBOTS = r"fanuc|(^|_)(m\d+i|lrmate|r\d000i|crx)"
MAKER = FANUC

__all__ = ["ENDINGS", "MAKER", "NAME", "ROBOTS", "fingerprint", "looks_like", "read_for", "write_moves"]
