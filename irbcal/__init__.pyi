"""The front door: every public name. `irbcal/__init__.py` imports each on first use."""

from . import shipped as shipped
from .calibration import Calibration as Calibration
from .calibration import calibrate as calibrate
from .calibration import load as load
from .calibration import report as report
from .calibration import save as save
from .cell.simulation import Simulated as Simulated
from .cell.simulation import simulate as simulate
from .correction.filter import correct as correct
from .errors import CalibrationError as CalibrationError
from .errors import IdentificationError as IdentificationError
from .errors import IrbcalError as IrbcalError
from .errors import MeasurementError as MeasurementError
from .errors import OptionError as OptionError
from .errors import ProgramError as ProgramError
from .errors import RobotError as RobotError
from .files.dh_table import DhRobot as DhRobot
from .files.dh_table import urdf_from_dh as urdf_from_dh
from .files.robots import robots as robots
from .files.urdf import read_urdf as read_urdf
from .identification.evidence import identify_evidence as identify_evidence
from .identification.evidence_fit import EvidenceFit as EvidenceFit
from .joint_behaviour.behaviour import joints as joints
from .kinematics import forward_kinematics as forward_kinematics
from .kinematics import inverse_kinematics as inverse_kinematics
from .measurement.imports.reader import import_measurements as import_measurements
from .measurement.table import read_measurements as read_measurements
from .planners.calibrated_model import CalibratedModel as CalibratedModel
from .planning.measuring_plan import Plan as Plan
from .planning.measuring_plan import plan as plan
from .reports.certificate import certificate as certificate
from .studies.runner import study as study
from .validation.ballbar_check import ballbar as ballbar
from .validation.comparing import Compared as Compared
from .validation.comparing import compare as compare
from .validation.controller_check import controller as controller
from .validation.evaluate import evaluate as evaluate
from .validation.evaluation import Evaluation as Evaluation
from .validation.iso9283_check import iso9283 as iso9283
from .validation.iso9283_check import iso9283_plan as iso9283_plan
from .validation.tracker_check import tracker as tracker
from .validation.verification import verify as verify
from .viewer.view import view as view

__version__: str
