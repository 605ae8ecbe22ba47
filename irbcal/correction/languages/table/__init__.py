"""CSV tables of joints or poses."""

from irbcal.correction.languages.table.program import MARK, with_values
from irbcal.correction.languages.table.reader import POSE, fingerprint, parse, read, read_for

NAME = "CSV"
ENDINGS = (".csv",)

__all__ = ["ENDINGS", "MARK", "NAME", "POSE", "fingerprint", "parse", "read", "read_for", "with_values"]
