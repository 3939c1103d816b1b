import math

import numpy as np
import pytest

from planner.route_search import turned_around
from semmap.geometry.pose import Pose


def test_turning_is_by_half_a_turn():
    for yaw in np.linspace(-3.0, 3.0, 7):
        back = turned_around(Pose.planar(1.0, 2.0, float(yaw), 3.0))
        assert (back.x, back.y, back.z) == (1.0, 2.0, 3.0)
        assert math.cos(back.yaw - yaw) == pytest.approx(-1.0)
        assert back.qw >= 0
