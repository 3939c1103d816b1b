"""Topology, routes, tasks and missions over the semantic map.

Names are imported when they are used first, so that ``import planner`` is cheap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from planner.cost_rules import CostRule as CostRule
    from planner.cost_rules import CostRules as CostRules
    from planner.live_topology import LiveTopology as LiveTopology
    from planner.live_topology import TopologyChange as TopologyChange
    from planner.plan import Action as Action
    from planner.plan import Plan as Plan
    from planner.robot_class import Durations as Durations
    from planner.robot_class import RobotClass as RobotClass
    from planner.route import NoRouteError as NoRouteError
    from planner.route import Route as Route
    from planner.route import RouteStep as RouteStep
    from planner.route_planner import RoutePlanner as RoutePlanner
    from planner.routing_graph import Endpoint as Endpoint
    from planner.routing_graph import RoutingGraph as RoutingGraph
    from planner.task_planner import plan_task as plan_task
    from planner.topology import Place as Place
    from planner.topology import PlaceConnector as PlaceConnector
    from planner.topology import PlaceRegion as PlaceRegion
    from planner.topology import Topology as Topology
    from planner.topology import UnknownPlaceError as UnknownPlaceError

__getattr__, __all__ = load_on_use(__name__)
