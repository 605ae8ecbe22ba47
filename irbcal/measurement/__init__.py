"""Measurement: what was seen (tables, cleaning, registration)."""
