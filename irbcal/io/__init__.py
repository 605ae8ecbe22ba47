"""Reading and writing of robots and calibrations."""
