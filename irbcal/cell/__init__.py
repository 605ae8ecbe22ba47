"""The cell around a robot: tools and work objects, computed with the calibrated robot from touches."""
