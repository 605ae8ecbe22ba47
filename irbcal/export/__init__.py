"""What others read: URDF, the calibration folder, Pinocchio, the report."""
