"""Correction: from a calibrated robot to better motion with the controller's nominal model."""
