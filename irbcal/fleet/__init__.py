"""Many robots, many years: calibrated by a list, kept in a store, compared over time and with others of their type."""

STORE = "fleet.db"
"""The store of a fleet unless given; here, as help reads it where SQLAlchemy is not installed."""
