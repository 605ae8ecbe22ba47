"""irbcal: calibrate robot arms from laser-tracker measurements, with URDF in and URDF out.

The public names are those of the stub beside this file; they are imported on first use, so that ``import irbcal``
stays quick.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = "0.2.0"
