"""Studies in the virtual cell, after Nubiola 2011, chapter 7: calibrations repeated, tabulated beside the thesis's."""
