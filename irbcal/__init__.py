"""irbcal: calibrate robot arms from laser-tracker measurements, with URDF in and URDF out.

The public names are imported on first use, so that ``import irbcal`` stays quick.
"""

from importlib import import_module

_PUBLIC = {
    "CalibratedModel": ("irbcal.planners.calibrated_model", "CalibratedModel"),
    "IrbcalError": ("irbcal.errors", "IrbcalError"),
    "calibrate": ("irbcal.calibrating", "calibrate"),
    "evaluate": ("irbcal.calibrating", "evaluate"),
    "load": ("irbcal.files.calibration_folder", "load"),
    "read_measurements": ("irbcal.measurement.table", "read"),
    "read_urdf": ("irbcal.files.urdf", "read"),
    "save": ("irbcal.files.calibration_folder", "save"),
    "view": ("irbcal.viewer.view", "view"),
    "shipped": ("irbcal.files.robots", None),
}

__all__ = sorted(_PUBLIC)


def __getattr__(name):
    if name not in _PUBLIC:
        raise AttributeError(f"module 'irbcal' has no attribute {name!r}")
    module, attribute = _PUBLIC[name]
    found = import_module(module)
    return getattr(found, attribute) if attribute else found


def __dir__():
    return __all__
