"""CSV tables of joints or poses."""

from irbcal.correction.languages.table.program import MARK, with_values
from irbcal.correction.languages.table.reader import POSE, fingerprint, looks_like, parse, read, read_for

NAME = "CSV"
ENDINGS = (".csv",)
MAKER = None
ROBOTS = ""
write_moves = None

__all__ = [
    "ENDINGS",
    "MAKER",
    "MARK",
    "NAME",
    "POSE",
    "ROBOTS",
    "fingerprint",
    "looks_like",
    "parse",
    "read",
    "read_for",
    "with_values",
    "write_moves",
]
