"""Topology, routes, tasks and missions over the semantic map.

Names are imported when they are used first, so that ``import planner`` is cheap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from planner.cost_rules import CostRule, CostRules
    from planner.live_topology import LiveTopology, TopologyChange
    from planner.plan import Action, Plan
    from planner.robot_class import Durations, RobotClass
    from planner.route import NoRouteError, Route, RouteStep
    from planner.route_planner import RoutePlanner
    from planner.routing_graph import Endpoint, RoutingGraph
    from planner.task_planner import plan_task
    from planner.topology import Place, PlaceConnector, PlaceRegion, Topology, UnknownPlaceError

__all__ = [
    "Action",
    "CostRule",
    "CostRules",
    "Durations",
    "Endpoint",
    "LiveTopology",
    "NoRouteError",
    "Place",
    "PlaceConnector",
    "PlaceRegion",
    "Plan",
    "RobotClass",
    "Route",
    "RoutePlanner",
    "RouteStep",
    "RoutingGraph",
    "Topology",
    "TopologyChange",
    "UnknownPlaceError",
    "plan_task",
]

_MODULES = {
    "cost_rules": ("CostRule", "CostRules"),
    "live_topology": ("LiveTopology", "TopologyChange"),
    "plan": ("Action", "Plan"),
    "robot_class": ("Durations", "RobotClass"),
    "route": ("NoRouteError", "Route", "RouteStep"),
    "route_planner": ("RoutePlanner",),
    "routing_graph": ("Endpoint", "RoutingGraph"),
    "task_planner": ("plan_task",),
    "topology": ("Place", "PlaceConnector", "PlaceRegion", "Topology", "UnknownPlaceError"),
}

__getattr__ = load_on_use(
    __name__, {name: f"planner.{module}" for module, names in _MODULES.items() for name in names}
)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
