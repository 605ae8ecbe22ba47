"""ABB RAPID."""

from irbcal.correction.languages.rapid.reader import mark, parse, read

__all__ = ["mark", "parse", "read"]
