"""Names of the ways to identify, for the command line and for `irbcal.identification.methods` alike."""

METHODS = ("least-squares", "axes", "nelder-mead")
OBJECTIVES = ("rms", "max", "pnorm")
LOSSES = ("linear", "soft_l1", "huber")
