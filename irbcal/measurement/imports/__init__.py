"""Measurement files as other programs write them: a map says what stands where, the reader makes irbcal's own table."""
