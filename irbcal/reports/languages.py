"""Languages of reports and certificates; `irbcal.reports.translated_pages` writes them."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

Language: TypeAlias = Literal["en", "de", "fr", "ja", "zh"]
LANGUAGES: tuple[Language, ...] = get_args(Language)
