"""Colours of figures: one thing has one colour in the report, in the figures of validation and in the view."""

NOMINAL, CALIBRATED = "#dd7d11", "#1f72bd"
"""The two models; safe for the colour-blind."""

FROM_BELOW, FROM_ABOVE = "#1b9e77", "#7b3fa0"
"""Directions from which a joint was reached."""

ACCENT = "#7a5195"
"""What is neither a model nor measured."""

ERRORS = ("#2166ac", "#2b9c9c", "#d9a400", "#e8590c", "#9e0b26")
"""Sizes of errors, from zero to the top of a scale; the view has the same."""
