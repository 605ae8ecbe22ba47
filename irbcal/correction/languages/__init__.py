"""Robot programs: one file or folder a language, all with the interface of `irbcal.correction.program`."""
