"""What can be done with a map: the table from which the command line and the reference are made.

It is plain data, so that the command line starts quickly. Further faces read it, too.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, Literal

Right = Literal["reader", "robot", "admin", "owner", "none"]


@dataclass(frozen=True)
class Operation:
    """One thing that can be done.

    Attributes
    ----------
    method : the class and method that does it: ``Map.route``
    command : the words of the command line: ``route``, ``fields query``; None: Python alone
    right : the least role that may do it; ``none``: it needs no database
    """

    method: str
    command: str | None
    right: Right

    @cached_property
    def function(self) -> Any:
        """The method itself; of a property, the function that reads it."""
        owner, name = self.method.split(".")
        found = inspect.getattr_static(getattr(import_module(_HOMES[owner]), owner), name)
        return found.fget if isinstance(found, property) else found

    @property
    def summary(self) -> str:
        """The first line of the method's docstring."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]


_HOMES = {
    "Database": "semmap.api.database",
    "Map": "semmap.api.map",
    "MapEntity": "semmap.api.map_entity",
    "Door": "semmap.api.map_entity",
    "SpatialFields": "semmap.api.spatial_fields",
}

COMMANDS = {
    "belief": "semmap.cli.belief:belief",
    "costmap": "semmap.cli.grids:costmap_command",
    "demo": "semmap.cli.demo.command:demo_command",
    "fields": "semmap.cli.fields:fields",
    "grasp": "semmap.cli.manipulation:grasp_command",
    "grid": "semmap.cli.grids:grid_command",
    "interlink": "semmap.cli.interlinking:interlink",
    "knowledge": "semmap.cli.knowledge:knowledge",
    "manipulation": "semmap.cli.manipulation_group:manipulation",
    "missions": "semmap.cli.missions:missions_command",
    "observe": "semmap.cli.belief:observe_command",
    "place": "semmap.cli.manipulation:place_command",
    "plan": "semmap.cli.plan:plan_command",
    "push": "semmap.cli.manipulation:push_command",
    "rdf": "semmap.cli.knowledge:rdf",
    "regions": "semmap.cli.regions:regions",
    "robot": "semmap.cli.robot:robot",
    "rooms": "semmap.cli.rooms:rooms",
    "route": "semmap.cli.route:route_command",
    "run": "semmap.cli.missions:run_command",
    "search": "semmap.cli.missions:search_command",
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
    Operation("Map.fix", "check", "admin"),
    Operation("Database.import_file", "import", "admin"),
    Operation("Database.create_map", None, "admin"),
    Operation("Database.map", None, "reader"),
    Operation("Database.add_robot", "robot add", "robot"),
    Operation("Database.driving_posture", "robot add", "reader"),
    Operation("Database.delete_robot", "robot rm", "admin"),
    Operation("Map.robots", "robot ls", "reader"),
    Operation("Map.robot_parts", None, "reader"),
    Operation("Map.add_storey", None, "admin"),
    Operation("Map.add_room", None, "admin"),
    Operation("Map.add_door", None, "admin"),
    Operation("Map.add_region", None, "robot"),
    Operation("Map.add_object", None, "robot"),
    Operation("Map.add_agent", None, "robot"),
    Operation("Map.find", "ls", "reader"),
    Operation("Map.incomplete", "ls", "reader"),
    Operation("Map.guessed_types", "ls", "reader"),
    Operation("Map.changes", None, "reader"),
    Operation("Database.changes", "changes", "reader"),
    Operation("Map.execute", None, "reader"),
    Operation("Map.grid", "grid", "reader"),
    Operation("Map.grids", "grid", "reader"),
    Operation("Map.costmap", "costmap", "reader"),
    Operation("Map.costmaps", "costmap", "reader"),
    Operation("Map.route", "route", "reader"),
    Operation("Map.routes", "route", "reader"),
    Operation("Map.topology", None, "reader"),
    Operation("Map.routing_graph", "topology", "reader"),
    Operation("Map.live_topology", None, "reader"),
    Operation("Map.write_topology", "topology", "reader"),
    Operation("Map.draw", None, "reader"),
    Operation("Map.draw_3d", None, "reader"),
    Operation("Map.views", None, "reader"),
    Operation("Map.plan", "plan", "reader"),
    Operation("Map.run", "run", "admin"),
    Operation("Map.missions", "missions", "reader"),
    Operation("Map.mission_steps", "missions", "reader"),
    Operation("Map.cancel_mission", "missions", "robot"),
    Operation("Map.search", "search", "reader"),
    Operation("Map.spot", None, "reader"),
    Operation("Map.check_type", None, "reader"),
    Operation("Map.ended_fields", None, "reader"),
    Operation("Database.maps", "maps", "reader"),
    Operation("Map.rooms", None, "reader"),
    Operation("Map.objects", None, "reader"),
    Operation("Map.doors", None, "reader"),
    Operation("Map.storeys", None, "reader"),
    Operation("Map.regions", None, "reader"),
    Operation("Map.agents", None, "reader"),
    Operation("Map.subscribe", None, "reader"),
    Operation("Map.to_geodataframe", None, "reader"),
    Operation("Map.export", None, "reader"),
    Operation("MapEntity.name", None, "admin"),
    Operation("MapEntity.type", None, "robot"),
    Operation("MapEntity.label", None, "robot"),
    Operation("MapEntity.properties", None, "robot"),
    Operation("MapEntity.is_a", None, "reader"),
    Operation("MapEntity.describe", "show", "reader"),
    Operation("MapEntity.pose", None, "reader"),
    Operation("MapEntity.holder", None, "reader"),
    Operation("MapEntity.contents", None, "reader"),
    Operation("MapEntity.room", None, "reader"),
    Operation("MapEntity.storey", None, "reader"),
    Operation("MapEntity.relation", None, "reader"),
    Operation("MapEntity.geometry", None, "reader"),
    Operation("MapEntity.footprint", None, "reader"),
    Operation("MapEntity.mesh", None, "reader"),
    Operation("MapEntity.size", None, "reader"),
    Operation("MapEntity.box", None, "reader"),
    Operation("MapEntity.history", None, "reader"),
    Operation("MapEntity.move_to", None, "robot"),
    Operation("MapEntity.put_on", None, "robot"),
    Operation("MapEntity.put_in", None, "robot"),
    Operation("MapEntity.delete", None, "admin"),
    Operation("Door.state", None, "robot"),
    Operation("Door.places", None, "reader"),
    Operation("Door.width", None, "reader"),
    Operation("Door.form", None, "reader"),
    # what robots do with objects
    Operation("Map.grasps", "grasp", "robot"),
    Operation("Map.places", "place", "robot"),
    Operation("Map.pushes", "push", "robot"),
    Operation("Map.find_shapes", "manipulation shapes", "robot"),
    Operation("Map.record_attempt", "manipulation record", "robot"),
    Operation("Map.practise", "manipulation try", "admin"),
    Operation("Map.list_manipulations", "manipulation tasks", "reader"),
    Operation("Database.grasps_of_shape", "grasp", "reader"),
    Operation("Database.add_gripper", "manipulation add-gripper", "admin"),
    Operation("Database.list_grippers", "manipulation grippers", "reader"),
    Operation("Database.add_manipulator", "manipulation add-robot", "admin"),
    Operation("Database.list_manipulators", "manipulation robots", "reader"),
    Operation("Database.import_grasps", "manipulation import-grasps", "admin"),
    Operation("Database.export_manipulation", "manipulation export", "reader"),
    Operation("Database.import_manipulation", "manipulation import", "admin"),
    Operation("Database.manipulation_key", "manipulation key", "none"),
    Operation("Database.trust_contributor", "manipulation trust", "admin"),
    Operation("Database.list_contributors", "manipulation contributors", "reader"),
    # where objects are, and what is known of them
    Operation("Map.where", "where", "reader"),
    Operation("Map.beliefs", "where", "reader"),
    Operation("Map.draw_belief", "where", "reader"),
    Operation("Map.observe", "observe", "robot"),
    Operation("Map.observe_point", "observe", "robot"),
    Operation("Map.observe_view", "observe", "robot"),
    Operation("Map.observe_objects", "observe", "robot"),
    Operation("Map.initial_belief", "belief initial", "reader"),
    Operation("Map.identify", "belief identify", "reader"),
    Operation("Map.belief_field", "belief field", "robot"),
    Operation("Map.export_belief", "belief export", "reader"),
    Operation("Map.teach", "teach", "robot"),
    Operation("Map.how_to", "belief how", "reader"),
    Operation("Map.grammar", "belief grammar", "reader"),
    Operation("Map.find_rooms", "rooms find", "admin"),
    Operation("Map.find_regions", "regions find", "admin"),
    Operation("Map.draw_region", "regions draw", "robot"),
    Operation("Map.list_regions", "regions ls", "reader"),
    # data sets
    Operation("Database.interlink", "interlink link", "robot"),
    Operation("Database.list_link_sets", "interlink ls", "reader"),
    Operation("Database.merged_records", "interlink show", "reader"),
    Operation("Database.undo_links", "interlink undo", "admin"),
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
