"""The calibrated robot for planners built on Pinocchio."""
