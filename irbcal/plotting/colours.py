"""Colours of figures: one thing has one colour in the report, in the figures of validation and in the view."""

NOMINAL, CALIBRATED = "#dd7d11", "#1f72bd"
"""The two models; safe for the colour-blind."""

FROM_BELOW, FROM_ABOVE, UNKNOWN = "#1b9e77", "#7b3fa0", "#8a8a8a"
"""Directions from which a joint was reached; the last: not known."""

MEASURED, ACCENT = "#333333", "#7a5195"
"""Measured values, and what is computed from them: neither is a model's colour."""

SERIES = (MEASURED, ACCENT, "#2f8f5b", "#a0527a", "#6b7280")
"""Runs of one kind, in their order."""

TEXT, SOFT, RULE, PAPER = "#1b1f24", "#59636e", "#d5dade", "#ffffff"
"""Words; smaller words and axes; lines of a grid; the ground."""

ERRORS = ("#2166ac", "#2b9c9c", "#d9a400", "#e8590c", "#9e0b26")
"""Sizes of errors, from zero to the top of a scale; the view has the same."""
