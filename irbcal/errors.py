"""The errors that irbcal raises on purpose.

Every message is one sentence for the person at the keyboard: where (file, row, column), what was
expected, what was found. The command line prints it and exits with code 1; anything else keeps its
traceback.
"""


class IrbcalError(Exception):
    """Base of all refusals; the message is written for the user."""


class RobotError(IrbcalError):
    """A robot description (URDF) cannot be used."""


class MeasurementError(IrbcalError):
    """A measurement or joint file cannot be used."""


class IdentificationError(IrbcalError):
    """The measurements do not allow the identification that was asked for."""


class CalibrationError(IrbcalError):
    """A calibration folder cannot be read, written or trusted."""


class ProgramError(IrbcalError):
    """A robot program cannot be read, understood or rewritten."""
