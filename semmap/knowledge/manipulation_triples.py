"""What robots know of manipulation as triples: automata, object models, actions, tasks, links.

The classes are those of `schema/ontology/knowledge/manipulation.ttl` (Tosello, Fan and Pagello,
section III). All but tasks and paths belong to no map, and are in the graph of each.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from semmap.knowledge.triple_map import Node, TripleMap, TripleTables, Value, columns_of, constant
from semmap.knowledge.vocabulary import OWL, RDF, RDFS, SEMMAP

MANIPULATION_NODES: dict[str, Node] = {
    "device": Node("urn:semmap:device:", keyed=("device", "name", "text")),
    "automaton": Node("urn:semmap:automaton:", keyed=("automaton", "name", "text")),
    "object model": Node("urn:semmap:object-model:", keyed=("object_model", "key", "text")),
    "action": Node("urn:semmap:action:", keyed=("action", "key", "uuid")),
    "task": Node("urn:semmap:task:"),
    "path": Node("urn:semmap:path:"),
}

DEVICE = TripleTables(("device",), key="{a}.id")
GRIPPER = TripleTables(("gripper",), key="{a}.device_id")
AUTOMATON = TripleTables(("automaton",), key="{a}.id")
OBJECT = TripleTables(("object_model",), key="{a}.id")
ACTION = TripleTables(("action",), key="{a}.id")
TASK = TripleTables(("task",), map_id="{a}.map_id", key="{a}.id")
PATH = TripleTables(("path",), map_id="{a}.map_id", key="{a}.id")

_DEVICE = Value("device", "{a}.id")
_AUTOMATON = Value("automaton", "{a}.id")
_OBJECT = Value("object model", "{a}.id")
_ACTION = Value("action", "{a}.id")
_TASK = Value("task", "{a}.id")
_PATH = Value("path", "{a}.id")

_TYPE_FUNCTIONS = (
    "(SELECT DISTINCT c.sub, f.use FROM type_closure c JOIN semantic_type t ON t.name = c.super, "
    "unnest(t.functions) f (use)) AS {b}"
)
_MODELLED = TripleTables(("entity_object", "entity"), ("{b}.id = {a}.entity_id",), "{b}.map_id")


def _class_of(name: str) -> Value:
    """Return the IRI that a word of the tables has in the ontology: drinking, :Drinking."""
    camel = f"iri_encode(replace(initcap(replace({name}, '_', ' ')), ' ', ''))"
    return Value("iri", f"(text '{SEMMAP}' || {camel})")


def _text_of_pose(name: str) -> str:
    return f"array_to_string({{a}}.{name}, ' ')"


def _typed(
    source: TripleTables, subject: Value, *types: str, where: str = ""
) -> Iterator[TripleMap]:
    """Yield triple maps that give the rows of a source classes of the ontology."""
    if where:
        source = TripleTables(source.tables, (*source.where, where), source.map_id, source.key)
    for type_ in types:
        yield TripleMap(f"{RDF}type", source, subject, constant(f"{SEMMAP}{type_}"))


def _kinds() -> Iterator[TripleMap]:
    for kind in ("robot", "gripper", "sensor"):
        name = f"{kind.capitalize()}Model"
        yield from _typed(DEVICE, _DEVICE, name, where=f"{{a}}.kind = '{kind}'")
    for kind in ("grasp", "place", "push", "turn", "open", "put"):
        names = ("Push", "Turn") if kind == "turn" else (kind.capitalize(),)
        yield from _typed(ACTION, _ACTION, *names, where=f"{{a}}.kind = '{kind}'")
    forms = (("parallel", "Parallel"), ("multi-finger", "MultiFinger"), ("suction", "Suction"))
    for form, name in forms:
        hand = Value("device", "{a}.device_id")
        yield from _typed(GRIPPER, hand, f"{name}Gripper", where=f"{{a}}.form = '{form}'")
    for shape in ("sphere", "cylinder", "cone", "cuboid"):
        source = TripleTables(OBJECT.tables, (f"{{a}}.shape = '{shape}'",), key=OBJECT.key)
        yield TripleMap(
            f"{SEMMAP}hasShape", source, _OBJECT, constant(f"{SEMMAP}{shape.capitalize()}")
        )


def _functions() -> Iterator[TripleMap]:
    uses, of_type = "unnest({a}.functions) AS {b}(use)", ("{b}.sub = {a}.type",)
    not_of_type = ("{b}.use <> ALL (functions_of({a}.type))",)
    own = "(SELECT o.id, f.use FROM object_model o, unnest(o.functions) f (use)) AS {c}"
    of_model = TripleTables(
        (*_MODELLED.tables, own),
        (*_MODELLED.where, "{c}.id = {a}.object_id", "{c}.use <> ALL (functions_of({b}.type))"),
        _MODELLED.map_id,
    )
    of_entity = TripleTables(("entity", _TYPE_FUNCTIONS), of_type, "{a}.map_id")
    name = "hasFunction"
    for property_, source, subject, use in (
        ("usedFor", TripleTables(("semantic_type", uses)), Value("type", "{a}.name"), "{b}.use"),
        (name, TripleTables(("object_model", _TYPE_FUNCTIONS), of_type), _OBJECT, "{b}.use"),
        (name, TripleTables(("object_model", uses), not_of_type), _OBJECT, "{b}.use"),
        (name, of_entity, Value("entity", "{a}.id"), "{b}.use"),
        (name, of_model, Value("entity", "{a}.entity_id"), "{c}.use"),
    ):
        yield TripleMap(f"{SEMMAP}{property_}", source, subject, _class_of(use))


def _links() -> Iterator[TripleMap]:
    """Yield owl:sameAs between entities, object models and records of files (section III-D)."""
    forms = {"entity": "entity", "object model": "object", "iri": "iri"}
    for left, right in product(forms, repeat=2):
        a, b = f"{{a}}.left_{forms[left]}", f"{{a}}.right_{forms[right]}"
        in_map = "entity" in (left, right)
        yield TripleMap(
            f"{OWL}sameAs",
            TripleTables(
                ("same_as()",),
                (f"{a} IS NOT NULL", f"{b} IS NOT NULL"),
                "{a}.map_id" if in_map else None,
            ),
            Value(left, a),
            Value(right, b),
            shared=True,
        )


MANIPULATION_TRIPLES: tuple[TripleMap, ...] = (
    *_kinds(),
    # Components of robots
    *_typed(DEVICE, _DEVICE, "Device"),
    TripleMap(f"{RDFS}label", DEVICE, _DEVICE, Value("string", "{a}.name"), shared=True),
    TripleMap(
        f"{SEMMAP}capability",
        TripleTables(("device", "unnest({a}.capabilities) AS {b}(name)")),
        _DEVICE,
        _class_of("{b}.name"),
    ),
    *columns_of(
        GRIPPER,
        Value("device", "{a}.device_id"),
        ("gripperForm", "string", "{a}.form"),
        ("opening", "double", "{a}.opening"),
        ("fingerDepth", "double", "{a}.depth"),
        ("sweptVolume", "double", "{a}.swept"),
        ("vacuumForce", "double", "{a}.force"),
        ("preferred", "boolean", "{a}.preferred"),
    ),
    *_typed(AUTOMATON, _AUTOMATON, "Automaton"),
    TripleMap(f"{RDFS}label", AUTOMATON, _AUTOMATON, Value("string", "{a}.name"), shared=True),
    *columns_of(
        AUTOMATON,
        _AUTOMATON,
        ("hasRobot", "device", "{a}.robot_id"),
        ("hasGripper", "device", "{a}.gripper_id"),
        ("hasSensor", "device", "{a}.sensor_id"),
    ),
    # Objects and their shapes
    *_typed(OBJECT, _OBJECT, "ObjectModel"),
    TripleMap(
        f"{RDFS}label",
        OBJECT,
        _OBJECT,
        Value("string", "{a}.name"),
        nullable=True,
        shared=True,
    ),
    *columns_of(
        OBJECT,
        _OBJECT,
        ("modelOf", "type", "{a}.type"),
        ("shapeFit", "double", "{a}.inliers"),
        ("shapeRadius", "double", "CASE WHEN {a}.shape <> 'cuboid' THEN {a}.size[1] END"),
        (
            "shapeHeight",
            "double",
            "CASE {a}.shape WHEN 'cuboid' THEN {a}.size[3] WHEN 'sphere' THEN NULL "
            "ELSE {a}.size[2] END",
        ),
        ("shapeLength", "double", "CASE {a}.shape WHEN 'cuboid' THEN {a}.size[1] END"),
        ("shapeWidth", "double", "CASE {a}.shape WHEN 'cuboid' THEN {a}.size[2] END"),
    ),
    TripleMap(
        f"{SEMMAP}hasObjectModel",
        _MODELLED,
        Value("entity", "{a}.entity_id"),
        Value("object model", "{a}.object_id"),
    ),
    *_functions(),
    # Actions, tasks and paths; a pose is x y z and the quaternion x y z w
    *_typed(ACTION, _ACTION, "Action"),
    *columns_of(
        ACTION,
        _ACTION,
        ("actsOn", "object model", "{a}.object_id"),
        ("gripper", "device", "{a}.gripper_id"),
        ("approach", "string", "{a}.approach"),
        ("family", "string", "{a}.family"),
        ("width", "double", "{a}.width"),
        ("pose", "string", _text_of_pose("pose")),
        ("prePose", "string", _text_of_pose("pre_pose")),
        ("postPose", "string", _text_of_pose("post_pose")),
        ("quality", "double", "{a}.quality"),
        ("attempts", "double", "{a}.attempts"),
        ("successes", "double", "{a}.successes"),
        ("expectedSuccess", "double", "{a}.expected"),
        ("replacedBy", "action", "{a}.replaced_by"),
    ),
    TripleMap(
        f"{SEMMAP}contributor",
        TripleTables(("action", "contributor"), ("{b}.id = {a}.contributor_id",)),
        _ACTION,
        Value("string", "{b}.name"),
    ),
    TripleMap(
        f"{SEMMAP}hasStep",
        TripleTables(("action_step",)),
        Value("action", "{a}.whole_id"),
        Value("action", "{a}.step_id"),
    ),
    *_typed(TASK, _TASK, "Task"),
    *columns_of(
        TASK,
        _TASK,
        ("taskKind", "string", "{a}.kind"),
        ("taskRobot", "entity", "{a}.robot_id"),
        ("taskObject", "entity", "{a}.entity_id"),
        ("taskAction", "action", "{a}.action_id"),
        ("initialPose", "string", _text_of_pose("start")),
        ("finalPose", "string", _text_of_pose("goal")),
        ("deadline", "time", "{a}.deadline"),
        ("outcome", "string", "{a}.outcome"),
        ("message", "string", "{a}.message"),
        ("createdAt", "time", "{a}.created_at"),
        ("endedAt", "time", "{a}.ended_at"),
    ),
    *_typed(PATH, _PATH, "Path"),
    *columns_of(
        PATH,
        _PATH,
        ("pathOf", "automaton", "{a}.automaton_id"),
        ("link", "string", "nullif({a}.link, '')"),
        ("line", "geometry", "{a}.line"),
        ("clearance", "double", "{a}.clearance"),
        ("plannedAt", "time", "{a}.at"),
    ),
    *_links(),
)
"""The facts of manipulation and interlinking."""
