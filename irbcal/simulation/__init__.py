"""The virtual cell: a robot that errs beyond its model, a tool with reflectors and a laser tracker; SIMULATED data."""
