"""What can be done with a map: the table from which the command line and the reference are made.

It is plain data, so that the command line starts quickly. Further faces read it, too.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from semmap.api.signatures import Argument, read_signature

Right = Literal["reader", "robot", "admin", "owner", "none"]


class Operation(NamedTuple):
    """One thing that can be done."""

    method: str  # the class and method that does it: ``Map.route``
    command: str | None  # the words of the command line: ``fields query``; None: Python alone
    right: Right  # the least role that may do it; ``none``: it needs no database

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """What the method takes: names, types, defaults and help, as its source has them."""
        return read_signature(self.method).arguments

    @property
    def result(self) -> str:
        """The type that the method returns."""
        return read_signature(self.method).result

    @property
    def help(self) -> str:
        """The first line of the method's docstring."""
        return read_signature(self.method).help


class CommandWord(NamedTuple):
    """A first word of the command line: the module of `semmap.cli` that has it, and its help."""

    module: str
    help: str


COMMANDS = {
    "import": CommandWord("imports", "Read world files into the map: each in one transaction."),
    "maps": CommandWord("entities", "List the maps of the database."),
    "use": CommandWord("entities", "Choose the map that commands take when none is named."),
    "types": CommandWord("entities", "List the semantic types, and how many entities are of each."),
    "ls": CommandWord(
        "entities", "List entities: of a type, with properties, in a room, near a point."
    ),
    "show": CommandWord("entities", "Show all that the map has of one entity."),
    "check": CommandWord("entities", "Judge a map; exit code 1 if there are errors."),
    "sql": CommandWord("entities", "Run a SQL statement; one that reads, unless --write is given."),
    "changes": CommandWord("entities", "Show what changed since a cursor, and the next cursor."),
    "drop": CommandWord("entities", "Delete a map and all that is in it."),
    "db": CommandWord("database_commands", "The database: start, stop, revisions, psql."),
    "ask": CommandWord("belief", "Answer a sentence of the map's grammar: where is the mug."),
    "belief": CommandWord("belief", "Messages, ProbLog, fields and grammars of beliefs."),
    "costmap": CommandWord("grids", "Compute a robot's layered costmaps and write them for Nav2."),
    "demo": CommandWord("demo.command", "Import a world, and show what follows from it."),
    "draw": CommandWord("drawing", "Draw the map, or an answer of it, as a picture."),
    "export": CommandWord("export", "Write the map to a file of another program."),
    "fields": CommandWord("fields", "What space contains, voxel by voxel."),
    "gis": CommandWord("gis", "The map in QGIS: a project that shows and edits it."),
    "grasp": CommandWord(
        "manipulation", "Show how to grasp an object: stored grasps, else generated."
    ),
    "grid": CommandWord("grids", "Write the obstacles of each storey as a Nav2 map."),
    "interlink": CommandWord("interlinking", "Find which records of two data sets are the same."),
    "knowledge": CommandWord("knowledge", "Infer facts, explain contradictions, validate shapes."),
    "manipulation": CommandWord(
        "manipulation_group", "Grippers, shapes, outcomes, and their sharing."
    ),
    "mcp": CommandWord("serving", "Serve the map as tools of the Model Context Protocol."),
    "missions": CommandWord("missions", "List missions, or the steps of one; cancel one."),
    "observe": CommandWord("belief", "Store what was seen where, or was looked for and not seen."),
    "open": CommandWord("manipulation", "Show how to open a door or drawer by its handle."),
    "place": CommandWord("manipulation", "Show where and how to put an object down."),
    "plan": CommandWord("plan", "Plan a task: the actions that reach a goal in the least time."),
    "push": CommandWord("manipulation", "Show how to push an object along what it stands on."),
    "rdf": CommandWord("knowledge", "Write the map as RDF, and read facts from RDF."),
    "regions": CommandWord(
        "regions", "Parts of rooms and objects: drawn, or found in the geometry."
    ),
    "robot": CommandWord("robot", "Classes of robots: their shape and abilities."),
    "rooms": CommandWord("rooms", "Rooms and doorways, found in walls."),
    "route": CommandWord("route", "Find the quickest route: its doors in order, with poses."),
    "run": CommandWord("missions", "Let a robot pursue a goal, through failures and restarts."),
    "search": CommandWord("missions", "Search for an object: where to look first and why."),
    "serve": CommandWord(
        "serving", "Serve all maps over HTTP: operations, events, OGC API - Features, SPARQL."
    ),
    "sparql": CommandWord(
        "knowledge", "Answer a SPARQL query on the map: facts, geometry and T-Box."
    ),
    "teach": CommandWord("belief", "Teach the map: knowledge, relations, actions and objects."),
    "topology": CommandWord("topology", "Write the topology for Nav2 or Open-RMF, as DOT or JSON."),
    "turn": CommandWord("manipulation", "Show how to push a door about its hinge."),
    "view": CommandWord("serving", "Show the map in 3D in the browser, and its changes live."),
    "where": CommandWord("belief", "Show where objects or agents probably are, or any of a type."),
}
"""The commands by their first words, in the order of help; ``NAME_command`` is one of a module."""

_PYTHON_ALONE: dict[tuple[str, Right], str] = {
    ("Database", "admin"): "create_map",
    ("Database", "reader"): "map",
    ("Map", "reader"): (
        "robot_parts changes execute topology live_topology views spot check_type "
        "ended_fields rooms objects doors storeys regions agents subscribe to_geodataframe"
    ),
    ("Map", "admin"): "add_storey add_room add_door",
    ("Map", "robot"): "add_region add_object add_agent knowledge_client",
    ("MapEntity", "admin"): "name delete",
    ("MapEntity", "robot"): "type label properties move_to put_on put_in",
    ("MapEntity", "reader"): (
        "is_a pose holder contents room storey relation geometry footprint mesh size box history"
    ),
    ("Door", "robot"): "state",
    ("Door", "reader"): "places width form",
}
"""What no command does: the names of members by their class and right."""

OPERATIONS: tuple[Operation, ...] = (
    Operation("Database.use", "use", "reader"),
    Operation("Database.list_maps", "maps", "reader"),
    Operation("Database.drop_map", "drop", "admin"),
    Operation("Map.import_file", "import", "admin"),
    Operation("Map.export", "export", "reader"),
    Operation("Map.draw", "draw", "reader"),
    Operation("Map.draw_3d", "draw", "reader"),
    Operation("Map.types", "types", "reader"),
    Operation("Map.table", "ls", "reader"),
    Operation("Map.describe", "show", "reader"),
    Operation("Map.check", "check", "reader"),
    Operation("Map.fix", "check", "admin"),
    Operation("Database.import_file", "import", "admin"),
    Operation("Database.add_robot", "robot add", "robot"),
    Operation("Database.driving_posture", "robot add", "reader"),
    Operation("Database.delete_robot", "robot rm", "admin"),
    Operation("Map.robots", "robot ls", "reader"),
    Operation("Map.find", "ls", "reader"),
    Operation("Map.incomplete", "ls", "reader"),
    Operation("Map.guessed_types", "ls", "reader"),
    Operation("Database.changes", "changes", "reader"),
    Operation("Map.grid", "grid", "reader"),
    Operation("Map.grids", "grid", "reader"),
    Operation("Map.costmap", "costmap", "reader"),
    Operation("Map.costmaps", "costmap", "reader"),
    Operation("Map.route", "route", "reader"),
    Operation("Map.routes", "route", "reader"),
    Operation("Map.routing_graph", "topology", "reader"),
    Operation("Map.write_topology", "topology", "reader"),
    Operation("Map.write_qgis_project", "gis project", "reader"),
    Operation("Map.store_qgis_project", "gis project", "owner"),
    Operation("Map.plan", "plan", "reader"),
    Operation("Map.run", "run", "admin"),
    Operation("Map.missions", "missions", "reader"),
    Operation("Map.mission_steps", "missions", "reader"),
    Operation("Map.cancel_mission", "missions", "robot"),
    Operation("Map.search", "search", "reader"),
    Operation("Database.maps", "maps", "reader"),
    Operation("MapEntity.describe", "show", "reader"),
    # what robots do with objects
    Operation("Map.grasps", "grasp", "robot"),
    Operation("Map.places", "place", "robot"),
    Operation("Map.pushes", "push", "robot"),
    Operation("Map.openings", "open", "robot"),
    Operation("Map.turns", "turn", "robot"),
    Operation("Map.find_shapes", "manipulation shapes", "robot"),
    Operation("Map.record_attempt", "manipulation record", "robot"),
    Operation("Map.practise", "manipulation try", "admin"),
    Operation("Map.list_manipulations", "manipulation tasks", "reader"),
    Operation("Database.grasps_of_shape", "grasp", "reader"),
    Operation("Database.grasps_in_cloud", "grasp", "reader"),
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
    Operation("Map.which", "belief which", "reader"),
    Operation("Map.observe", "observe", "robot"),
    Operation("Map.observe_point", "observe", "robot"),
    Operation("Map.observe_view", "observe", "robot"),
    Operation("Map.observe_objects", "observe", "robot"),
    Operation("Map.initial_belief", "belief initial", "reader"),
    Operation("Map.identify", "belief identify", "reader"),
    Operation("Map.belief_field", "belief field", "robot"),
    Operation("Map.export_belief", "belief export", "reader"),
    Operation("Map.teach", "teach", "robot"),
    Operation("Map.ask", "ask", "reader"),
    Operation("Map.learn_belief", "belief learn", "admin"),
    Operation("Map.forget_learned", "belief forget", "admin"),
    Operation("Map.list_teachings", "belief taught", "reader"),
    Operation("Map.undo_teaching", "belief undo", "admin"),
    Operation("Map.how_to", "belief how", "reader"),
    Operation("Map.grammar", "belief grammar", "reader"),
    Operation("Map.find_rooms", "rooms find", "admin"),
    Operation("Map.merge_rooms", "rooms merge", "admin"),
    Operation("Map.split_room", "rooms split", "admin"),
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
    Operation("Map.graph", "rdf export", "reader"),
    Operation("Map.export_rdf", "rdf export", "reader"),
    Operation("Map.r2rml", "rdf mapping", "reader"),
    Operation("Map.export_r2rml", "rdf mapping", "reader"),
    Operation("Map.import_rdf", "rdf import", "robot"),
    Operation("Map.push_fields", "rdf push", "robot"),
    Operation("Map.serve_knowledge", "knowledge serve", "robot"),
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
    *(
        Operation(f"{owner}.{name}", None, right)
        for (owner, right), names in _PYTHON_ALONE.items()
        for name in names.split()
    ),
)

TOOLS = (
    "Map.find",
    "Map.describe",
    "Map.where",
    "Map.route",
    "Map.plan",
    "Map.search",
    "Map.draw",
    "Map.types",
    "Map.check",
    "Map.sparql",
    "Map.observe",
    "Map.observe_point",
    "MapEntity.move_to",
    "MapEntity.put_on",
    "Door.state",
    "Map.run",
)
"""The operations that programs which speak for people call, in their order."""
