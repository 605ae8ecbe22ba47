"""Validation: is the calibrated robot true."""
