"""ABB RAPID."""

from irbcal.correction.languages.rapid.marking import fingerprint, mark
from irbcal.correction.languages.rapid.reader import parse, read, read_for

NAME = "RAPID"
ENDINGS = (".mod", ".prg", ".sys", ".modx", ".sysx")

__all__ = ["ENDINGS", "NAME", "fingerprint", "mark", "parse", "read", "read_for"]
