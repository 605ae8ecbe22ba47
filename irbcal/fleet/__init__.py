"""Many robots, many years: calibrated by a list, kept in a store, compared over time and with their sisters."""
