"""A calibrated robot, its measured points and its errors to look at, in a browser or a notebook."""
