"""Modelling: what a robot is (DHM geometry, joint map, base, targets)."""
