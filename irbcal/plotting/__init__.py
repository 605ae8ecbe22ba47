"""Figures: one style for everything that people look at."""
