"""The whole job in a browser: the pages of ``irbcal app``. A step is a command line; its files are the state."""
