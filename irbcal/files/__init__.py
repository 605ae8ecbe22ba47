"""Files: how a robot and a calibration are read and written."""
