"""irbcal: calibrate robot arms from laser-tracker measurements, with URDF in and URDF out.

The public names are imported on first use, so that ``import irbcal`` stays quick.
"""

from importlib import import_module

_PUBLIC = {
    "CalibratedModel": ("irbcal.export.pinocchio_model", "CalibratedModel"),
    "IrbcalError": ("irbcal.errors", "IrbcalError"),
    "calibrate": ("irbcal.workflow", "calibrate"),
    "evaluate": ("irbcal.workflow", "evaluate"),
    "load": ("irbcal.export.calibration_file", "load"),
    "read_measurements": ("irbcal.measurement.table", "read"),
    "read_urdf": ("irbcal.export.urdf", "read"),
    "save": ("irbcal.export.calibration_file", "save"),
    "view": ("irbcal.view", None),
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
