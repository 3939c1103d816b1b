"""What can be done with a map: the table from which the command line and the reference are made.

It is plain data, so that the command line starts quickly. Further faces read it, too.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, Literal

__all__ = ["COMMANDS", "OPERATIONS", "Operation"]

Right = Literal["reader", "robot", "admin", "owner", "none"]


@dataclass(frozen=True)
class Operation:
    """One thing that can be done.

    Attributes
    ----------
    method : the class and method that does it: ``Map.route``
    command : the words of the command line: ``route``, ``fields query``; None: Python alone
    right : the least role that may do it; ``none``: it needs no database
    result : the type of the result, as the method's annotation names it
    """

    method: str
    command: str | None
    right: Right

    @cached_property
    def function(self) -> Any:
        """The method itself."""
        owner, name = self.method.split(".")
        found = inspect.getattr_static(getattr(import_module(_HOMES[owner]), owner), name)
        return found.fget if isinstance(found, property) else found

    @property
    def arguments(self) -> dict[str, inspect.Parameter]:
        """The arguments of the method, without `self`."""
        parameters = inspect.signature(self.function).parameters
        return {name: one for name, one in parameters.items() if name != "self"}

    @property
    def result(self) -> str:
        """The annotation of what the method returns."""
        returned = inspect.signature(self.function).return_annotation
        return returned if isinstance(returned, str) else getattr(returned, "__name__", "None")

    @property
    def summary(self) -> str:
        """The first line of the method's docstring."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]


_HOMES = {
    "Database": "semmap.api.database",
    "Map": "semmap.api.map",
    "MapEntity": "semmap.api.map_entity",
    "SpatialFields": "semmap.api.spatial_fields",
}

COMMANDS = {
    "belief": "semmap.cli.belief:belief",
    "costmap": "semmap.cli.costmap:costmap_command",
    "demo": "planner.cli.demo:demo_command",
    "fields": "semmap.cli.fields:fields",
    "grasp": "semmap.cli.manipulation:grasp_command",
    "grid": "semmap.cli.grid:grid_command",
    "interlink": "semmap.cli.interlinking:interlink",
    "knowledge": "semmap.cli.knowledge:knowledge",
    "manipulation": "semmap.cli.manipulation:manipulation",
    "missions": "semmap.cli.missions:missions_command",
    "observe": "semmap.cli.belief:observe_command",
    "place": "semmap.cli.manipulation:place_command",
    "plan": "semmap.cli.plan:plan_command",
    "push": "semmap.cli.manipulation:push_command",
    "rdf": "semmap.cli.knowledge:rdf",
    "regions": "semmap.cli.regions:regions",
    "robot": "semmap.cli.robot:robot",
    "route": "semmap.cli.route:route_command",
    "run": "semmap.cli.missions:run_command",
    "search": "semmap.cli.search:search_command",
    "sparql": "semmap.cli.knowledge:sparql_command",
    "teach": "semmap.cli.belief:teach_command",
    "topology": "semmap.cli.topology:topology_command",
    "where": "semmap.cli.belief:where_command",
}
"""Where the command of a first word is: a function, or a group (`typer.Typer`)."""

OPERATIONS: tuple[Operation, ...] = (
    Operation("Database.use", "use", "reader"),
    Operation("Database.list_maps", "maps", "reader"),
    Operation("Database.drop_map", "drop", "admin"),
    Operation("Map.import_file", "import", "admin"),
    Operation("Map.types", "types", "reader"),
    Operation("Map.table", "ls", "reader"),
    Operation("Map.describe", "show", "reader"),
    Operation("Map.check", "check", "reader"),
    Operation("Database.sql", "sql", "reader"),
    Operation("Map.sql", "sql", "reader"),
    Operation("Map.sparql", "sparql", "reader"),
    Operation("Map.update", "sparql", "robot"),
    Operation("Map.watch_sparql", "sparql", "reader"),
    Operation("Map.knowledge_client", None, "robot"),
    Operation("Map.graph", "rdf export", "reader"),
    Operation("Map.export_rdf", "rdf export", "reader"),
    Operation("Map.import_rdf", "rdf import", "robot"),
    Operation("Map.push_fields", "rdf push", "robot"),
    Operation("Map.serve_sparql", "rdf serve", "reader"),
    Operation("Map.reason", "knowledge reason", "robot"),
    Operation("Map.keep_reasoning", "knowledge reason", "robot"),
    Operation("Map.forget_inferences", "knowledge reason", "robot"),
    Operation("Map.contradictions", "knowledge contradictions", "reader"),
    Operation("Map.why", "knowledge why", "reader"),
    Operation("Map.validate", "knowledge validate", "reader"),
    Operation("Map.bind_shapes", "knowledge bind", "admin"),
    Operation("Map.unbind_shapes", "knowledge bind", "admin"),
    Operation("Map.binding_shapes", "knowledge bind", "reader"),
    Operation("SpatialFields.at", "fields at", "reader"),
    Operation("SpatialFields.ls", "fields ls", "reader"),
    Operation("SpatialFields.query", "fields query", "reader"),
    Operation("SpatialFields.update", "fields update", "robot"),
    Operation("SpatialFields.kept", "fields kept", "reader"),
    Operation("SpatialFields.forget", "fields forget", "robot"),
    Operation("SpatialFields.watch", "fields watch", "robot"),
    Operation("SpatialFields.export", "fields export", "reader"),
    Operation("SpatialFields.serve", "fields serve", "robot"),
    Operation("SpatialFields.send", "fields send", "none"),
    Operation("SpatialFields.sources", "fields source ls", "none"),
    Operation("SpatialFields.start_source", "fields source start", "none"),
    Operation("SpatialFields.stop_source", "fields source stop", "none"),
)
