"""Kawasaki AS."""

from irbcal.correction.languages.kawasaki.moves import write_moves
from irbcal.correction.languages.kawasaki.reader import fingerprint, looks_like, read_for
from irbcal.correction.languages.kawasaki.writing import KAWASAKI

NAME = "Kawasaki AS"
ENDINGS = (".as", ".pg")
ROBOTS = r"kawasaki|khi|(^|_)rs\d{3}"
MAKER = KAWASAKI

__all__ = ["ENDINGS", "MAKER", "NAME", "ROBOTS", "fingerprint", "looks_like", "read_for", "write_moves"]
