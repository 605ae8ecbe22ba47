"""Languages of reports and certificates; `irbcal.reports.translated_pages` writes them."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

PageLanguage: TypeAlias = Literal["en", "de", "fr", "ja", "zh"]
LANGUAGES: tuple[PageLanguage, ...] = get_args(PageLanguage)
