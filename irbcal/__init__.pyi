"""The front door: every public name. `irbcal/__init__.py` imports each on first use."""

from . import shipped as shipped
from .calibration import Calibration as Calibration
from .calibration import calibrate as calibrate
from .calibration import load as load
from .calibration import report as report
from .calibration import save as save
from .correction.filter import correct as correct
from .cell.simulation import Simulated as Simulated
from .cell.simulation import simulate as simulate
from .errors import CalibrationError as CalibrationError
from .errors import IdentificationError as IdentificationError
from .errors import IrbcalError as IrbcalError
from .errors import MeasurementError as MeasurementError
from .errors import OptionError as OptionError
from .errors import ProgramError as ProgramError
from .errors import RobotError as RobotError
from .files.robots import robots as robots
from .files.urdf import read_urdf as read_urdf
from .measurement.imports.reader import import_measurements as import_measurements
from .measurement.table import read_measurements as read_measurements
from .planners.calibrated_model import CalibratedModel as CalibratedModel
from .planning.measuring_plan import Plan as Plan
from .planning.measuring_plan import plan as plan
from .validation.evaluate import evaluate as evaluate
from .validation.evaluation import Evaluation as Evaluation
from .validation.verification import verify as verify
from .viewer.view import view as view

__version__: str
