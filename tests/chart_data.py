"""What panels of charts were given to draw, in units of the data."""

from collections import defaultdict

import numpy as np
import pytest

from irbcal.plotting.charts import Panel


@pytest.fixture
def given(monkeypatch):
    """Colour -> data of the lines and dots drawn so far: kind, x, y."""
    rows = defaultdict(list)

    def recorded(kind, original):
        def draw(self, x, y, colour, *args, **style):
            rows[colour].append((kind, np.ravel(x).astype(float), np.ravel(y).astype(float)))
            return original(self, x, y, colour, *args, **style)

        return draw

    for kind in ("line", "dots"):
        monkeypatch.setattr(Panel, kind, recorded(kind, getattr(Panel, kind)))
    return rows


def texts(chart):
    """Words in the drawings of a chart."""
    return [item.text for drawing in chart.drawings for item in drawing.marks if hasattr(item, "text")]
