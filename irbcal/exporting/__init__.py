"""The calibrated robot as a part of other programs: exports, one file a target, and live correction."""
