"""Which rooms the demo tries to reach."""

from __future__ import annotations

from itertools import pairwise

from planner.topology import Place, PlaceConnector, Topology
from semmap.cli.demo.choices import DemoChoices
from semmap.cli.demo.task import MOST, tasks
from semmap.geometry.pose import Pose


def test_rooms_of_the_same_storey_are_among_the_first_that_are_tried() -> None:
    names = [f"{storey}_{number}" for storey in ("low", "high") for number in range(9)]
    places = [Place(name, storey=name.split("_")[0]) for name in names]
    poses = (Pose(-1.0), Pose(1.0))
    doors = [PlaceConnector(f"{a}-{b}", (a, b), poses) for a, b in pairwise(names)]
    topology = Topology.of(places, doors)
    tried = [goal for _, goal in tasks(topology, DemoChoices())][:MOST]
    assert sum("low_" in goal for goal in tried) == sum("high_" in goal for goal in tried) == 3
    assert not any('"low_0"' in goal for goal in tried)  # where the robot starts
