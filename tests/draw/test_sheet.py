"""A title is inside of its picture, however narrow that is."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from semmap.draw.sheet import draw_title


@pytest.mark.parametrize("inches", [2.0, 2.8, 11.0])
def test_a_title_fits_into_its_picture(inches: float) -> None:
    figure = Figure(figsize=(inches, 3), dpi=200)
    text = draw_title(figure, "Figure 6: the robot's parts", 0.9, 15)
    box = text.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width * 0.98
    assert (text.get_fontsize() == 15) == (inches > 4)
