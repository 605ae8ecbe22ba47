"""ABB RAPID."""

from irbcal.correction.languages.rapid.marking import fingerprint, mark
from irbcal.correction.languages.rapid.moves import write_moves
from irbcal.correction.languages.rapid.reader import looks_like, parse, read, read_for

NAME = "RAPID"
ENDINGS = (".mod", ".prg", ".sys", ".modx", ".sysx")
ROBOTS = r"(^|_)(abb|irb_?\d)"
MAKER = None

__all__ = [
    "ENDINGS",
    "MAKER",
    "NAME",
    "ROBOTS",
    "fingerprint",
    "looks_like",
    "mark",
    "parse",
    "read",
    "read_for",
    "write_moves",
]
