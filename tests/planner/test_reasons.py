import math

import numpy as np
import pytest

from planner.network import Network
from planner.route import NoRouteError
from planner.topology import Place, Topology
from planner.walks import StraightWalks, Walked
from semmap.geometry.pose import Pose


def test_a_place_without_doors_says_so_and_one_within_itself_what_it_is():
    class Walled:
        def between(self, place, a, b):
            walked = StraightWalks().between(place, a, b)
            apart = np.array([[(p.x < 1.5) != (q.x < 1.5) for q in b] for p in a])
            return Walked(*(np.where(apart.reshape(k.shape), math.inf, k) for k in walked))

    islands = Topology.of([Place("a"), Place("b")], [])
    network = Network(islands, walks=Walled())
    with pytest.raises(NoRouteError, match="a has no door; add a connector"):
        network.route(network.site("a"), network.site("b"))
    near, far = network.site("a", Pose()), network.site("a", Pose(2.0))
    with pytest.raises(NoRouteError, match=r"finds no way in a from \(0.00, 0.00\) to \(2.00"):
        network.route(near, far)
    assert network.route(near, network.site("a", Pose(1.0))).metres == 1.0
