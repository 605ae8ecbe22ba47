"""Identification: from measurements to parameters."""
