"""The map as RDF: which table and columns each property stands for (R2RML's content, as data).

`TRIPLES` are facts: they are part of the graph, and `semmap rdf` writes them. `COMPUTED` are
relations that SQL functions decide when a query names them. To move one is to move its line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from semmap.knowledge.manipulation_triples import MANIPULATION_NODES, MANIPULATION_TRIPLES
from semmap.knowledge.triple_map import (
    Computed,
    Form,
    Node,
    TripleMap,
    TripleTables,
    Value,
    columns_of,
    constant,
    letters_from,
)
from semmap.knowledge.vocabulary import (
    GEO,
    OWL,
    PROPERTY,
    RDF,
    RDFS,
    RELATION,
    SEMMAP,
    SF,
    XSD,
)

BOT = "https://w3id.org/bot#"
CORA = "http://purl.org/ieee1872-owl/cora#"
ORO = "http://kb.openrobots.org#"

NODES: dict[Form, Node] = {
    "entity": Node("", of_map=True),
    "footprint": Node("footprint/", of_map=True),
    "box": Node("box/", of_map=True),
    "centroid": Node("centroid/", of_map=True),
    "type": Node(""),  # the IRI of the class in its ontology
    "belief": Node("urn:semmap:belief:"),
    "observation": Node("urn:semmap:observation:"),
    "model": Node("urn:semmap:model:"),
    "former": Node("urn:semmap:former:"),
    "voxel": Node("urn:semmap:voxel:0.05:"),  # indices x,y,z of a voxel of that edge, metres
    **MANIPULATION_NODES,
}

DATATYPES: dict[Form, str] = {
    "string": f"{XSD}string",
    "integer": f"{XSD}integer",
    "decimal": f"{XSD}decimal",
    "double": f"{XSD}double",
    "boolean": f"{XSD}boolean",
    "time": f"{XSD}dateTime",
    "geometry": f"{GEO}wktLiteral",
    "gml": f"{GEO}gmlLiteral",
    "geojson": f"{GEO}geoJSONLiteral",
}

JSON_TAGS = (
    *(DATATYPES[form] for form in ("string", "integer", "decimal", "boolean")),
    f"{RDF}JSON",
)
"""What the SQL function `json_tag` returns."""

ENTITY = TripleTables(("entity",), map_id="{a}.map_id", key="{a}.id")
TYPED = TripleTables(("object_type",), map_id="{a}.map_id")
WORLD = TripleTables(("world",), map_id="{a}.map_id", key="{a}.entity_id")
SHAPED = TripleTables(
    ("world",), ("{a}.footprint IS NOT NULL",), map_id="{a}.map_id", key="{a}.entity_id"
)
SHAPED_OBJECT = TripleTables(
    ("world", "entity"),
    ("{b}.id = {a}.entity_id", "{b}.kind = 'object'", "{a}.footprint IS NOT NULL"),
    "{a}.map_id",
    "{a}.entity_id",
)
PLACEMENT = TripleTables(("placement",), key="{a}.entity_id", one_map=True)
CONNECTOR = TripleTables(("connector",), key="{a}.entity_id")
ROOM = TripleTables(("room",), key="{a}.entity_id")
STOREY = TripleTables(("storey",), key="{a}.entity_id")
REGION = TripleTables(("region",), key="{a}.entity_id")
LINK = TripleTables(("link",))
CLASS = TripleTables(("semantic_type",), key="{a}.name")
BELIEF = TripleTables(("belief", "entity"), ("{b}.id = {a}.entity_id",), "{b}.map_id", "{a}.id")
OBSERVATION = TripleTables(
    ("observation", "entity"), ("{b}.id = {a}.entity_id",), "{b}.map_id", "{a}.id"
)
FORMER = TripleTables(("placement_history", "entity"), ("{b}.id = {a}.entity_id",), "{b}.map_id")
MODEL = TripleTables(("model",), key="{a}.id")
PROPERTIES = TripleTables(("entity", "jsonb_each({a}.properties)"), map_id="{a}.map_id")
HELD = TripleTables(("placement",), ("{a}.holder_id IS NOT NULL",), one_map=True)
IN_ROOM = TripleTables(("placement", "room"), ("{b}.entity_id = {a}.holder_id",))
OTHER_SIDE = TripleTables(("connector",), ("{a}.place_b <> {a}.place_a",), key="{a}.entity_id")
FOUND_IN = TripleTables(("semantic_type", "unnest({a}.found_in) AS {b}(place)"))

_ID = Value("entity", "{a}.id")
_OF = Value("entity", "{a}.entity_id")
_TYPE = Value("type", "{a}.name")
_JSON = Value("term", "json_text({b}.value)", "json_tag({b}.value)")
_FROM, _TO = Value("entity", "{a}.from_id"), Value("entity", "{a}.to_id")
_HOLDER = Value("entity", "{a}.holder_id")
_MODEL = Value("model", "{a}.id")
_BELIEF = Value("belief", "{a}.id")
_OBSERVATION = Value("observation", "{a}.id")
_SIDE_A, _SIDE_B = Value("entity", "{a}.place_a"), Value("entity", "{a}.place_b")
_FORMER = Value(
    "former",
    "({a}.entity_id || '.' || (extract(epoch FROM lower({a}.during)) * 1000000)::bigint)",
)
_CENTROID = (
    "ST_MakePoint((ST_XMin({a}.box) + ST_XMax({a}.box)) / 2, "
    "(ST_YMin({a}.box) + ST_YMax({a}.box)) / 2, (ST_ZMin({a}.box) + ST_ZMax({a}.box)) / 2)"
)
_BOX = "prism_tin(ST_Envelope({a}.box), ST_ZMin({a}.box), ST_ZMax({a}.box))"


def _typed_as(iri: str, *types: str) -> Iterator[TripleMap]:
    """Yield triple maps that give the entities of a type a class of another vocabulary."""
    for type_ in types:
        source = TripleTables(("object_type",), (f"{{a}}.type = '{type_}'",), "{a}.map_id")
        yield TripleMap(f"{RDF}type", source, _ID, constant(iri))


def _geometries() -> Iterator[TripleMap]:
    """Yield the geometries of features, and what GeoSPARQL has of each (1.1, sections 8 and 10)."""
    for form, source, geometry, roles in (
        ("footprint", SHAPED, "{a}.footprint", ("hasGeometry", "hasDefaultGeometry")),
        ("box", SHAPED, _BOX, ("hasBoundingBox",)),
        ("centroid", WORLD, _CENTROID, ("hasCentroid",)),
    ):
        node = Value(form, "{a}.entity_id")
        for role in roles:
            yield TripleMap(f"{GEO}{role}", source, _OF, node)
        shape = f"('{SF}' || substr(ST_GeometryType({geometry}), 4))"
        for class_ in (
            constant(f"{GEO}SpatialObject"),
            constant(f"{GEO}Geometry"),
            Value("iri", shape),
        ):
            yield TripleMap(f"{RDF}type", source, node, class_)
        for name, kind, sql in (
            ("hasSerialization", "geometry", geometry),
            ("asWKT", "geometry", geometry),
            ("asGML", "gml", f"ST_AsGML(3, {geometry})"),
            ("asGeoJSON", "geojson", f"ST_AsGeoJSON({geometry})"),
            ("dimension", "integer", f"ST_Dimension({geometry})"),
            ("coordinateDimension", "integer", f"ST_CoordDim({geometry})::int"),
            ("spatialDimension", "integer", f"ST_CoordDim({geometry})::int"),
            ("isEmpty", "boolean", f"ST_IsEmpty({geometry})"),
            ("isSimple", "boolean", f"ST_IsSimple(ST_Force2D({geometry}))"),
        ):
            yield TripleMap(f"{GEO}{name}", source, node, Value(kind, sql))
    for name, sql in (("Area", "ST_Area"), ("PerimeterLength", "ST_Perimeter")):
        size = Value("double", f"{sql}({{a}}.footprint)")
        yield TripleMap(f"{GEO}hasMetric{name}", SHAPED, _OF, size)


def _facts_of(table: str, condition: str, of_entity: str = "") -> Iterator[TripleMap]:
    """Yield the facts of a table of triples, by the forms of subject and object."""
    for of, subject in (
        ("{a}.subject_id", Value("entity", "{a}.subject_id")),
        ("{a}.subject", Value("iri", "{a}.subject")),
    ):
        for to, object_ in (
            ("{a}.object_id", Value("entity", "{a}.object_id")),
            ("{a}.object", Value("term", "{a}.object", "{a}.tag")),
        ):
            ids = [c.sql for c in (subject, object_) if c.form == "entity"]
            where = (
                *(f"{column} IS NOT NULL" for column in (of, to)),
                *(of_entity.replace("{id}", each) for each in ids if of_entity),
                condition,
            )
            source = TripleTables((table,), where, "{a}.map_id")
            yield TripleMap("", source, subject, object_, name="{a}.predicate")


_LASTS = "({a}.until IS NULL OR {a}.until > statement_timestamp())"

STATEMENTS: tuple[TripleMap, ...] = (
    TripleMap(
        "",
        TripleTables(("triple",), (_LASTS,), "{a}.map_id"),
        Value("resource", "{a}.subject"),
        Value("stored", "{a}.object"),
        name="{a}.predicate",
    ),
)
"""The table `triple`: numbers of entities and terms."""

STATEMENTS_AS_TEXTS: tuple[TripleMap, ...] = tuple(_facts_of("statement", _LASTS))
"""The view `statement`, by the forms of subject and object."""

INFERRED_GRAPH = "urn:semmap:inferred"  # the named graph of what rules infer; it cannot be written

INFERENCES: tuple[TripleMap, ...] = tuple(
    _facts_of("inference", "NOT {a}.told", "EXISTS (SELECT FROM entity WHERE id = {id})")
)
"""The inferences of the table `inference`, by the forms of subject and object: those of a deleted
entity stay there until the next run of the reasoner. Those from statements of a named graph are in
that graph, those of the map in `INFERRED_GRAPH`."""

_OF_MAP = f"{{a}}.graph = '{INFERRED_GRAPH}'"
INFERENCES_OF_MAP: tuple[TripleMap, ...] = tuple(
    replace(each, source=replace(each.source, where=(*each.source.where, _OF_MAP)))
    for each in INFERENCES
)
"""Those of the map alone, as files have them: read again, those of graphs would be statements."""

FACTS = STATEMENTS + INFERENCES
"""What the tables of triples have: single facts, each of which begins and ends by itself."""

TRIPLES: tuple[TripleMap, ...] = (
    # Entities: types with all that subsume them (section 3.5 of Deeken et al.), names, properties
    TripleMap(f"{RDF}type", TYPED, _ID, Value("type", "{a}.type"), shared=True),
    TripleMap(f"{RDF}type", ENTITY, _ID, constant(f"{GEO}Feature")),
    TripleMap(f"{RDF}type", ENTITY, _ID, constant(f"{GEO}SpatialObject")),
    *_typed_as(f"{BOT}Storey", "storey"),
    *_typed_as(f"{BOT}Space", "room"),
    *_typed_as(f"{BOT}Zone", "room", "storey"),
    *_typed_as(f"{BOT}Element", "object"),
    *_typed_as(f"{BOT}Interface", "connector"),
    *_typed_as(f"{CORA}Robot", "robot"),
    *_typed_as(f"{ORO}Agent", "agent"),
    *_typed_as(f"{ORO}Artifact", "object"),
    TripleMap(f"{SEMMAP}directType", ENTITY, _ID, Value("type", "{a}.type"), nullable=True),
    *columns_of(
        ENTITY,
        _ID,
        ("name", "string", "{a}.name"),
        ("kind", "string", "{a}.kind"),
        ("front", "double", "{a}.front"),
        ("since", "time", "{a}.since"),
        ("source", "string", "{a}.source"),
    ),
    TripleMap(
        f"{RDFS}label", ENTITY, _ID, Value("string", "{a}.label"), nullable=True, shared=True
    ),
    TripleMap(PROPERTY, PROPERTIES, _ID, _JSON, name="{b}.key"),
    # Links and inventories
    TripleMap(RELATION, LINK, _FROM, _TO, name="{a}.relation"),
    *columns_of(
        PLACEMENT,
        _OF,
        ("heldBy", "entity", "{a}.holder_id"),
        ("confidence", "double", "{a}.confidence"),
        ("placedSince", "time", "{a}.since"),
    ),
    TripleMap(f"{SEMMAP}holds", HELD, _HOLDER, _OF),
    *(
        TripleMap(
            iri,
            TripleTables(("placement",), (f"{{a}}.relation = '{relation}'",), one_map=True),
            _OF,
            _HOLDER,
            nullable=True,
        )
        for relation, iri in (
            ("on", f"{SEMMAP}placedOn"),
            ("on", f"{ORO}isOn"),
            ("in", f"{SEMMAP}placedIn"),
            ("in", f"{ORO}isIn"),
        )
    ),
    TripleMap(f"{BOT}containsElement", IN_ROOM, _HOLDER, _OF),
    TripleMap(
        f"{BOT}hasSpace",
        TripleTables(
            ("room", "world"),
            ("{b}.entity_id = {a}.entity_id", "{b}.storey_id IS NOT NULL"),
            "{b}.map_id",
        ),
        Value("entity", "{b}.storey_id"),
        _OF,
    ),
    # Where they are: metres and radians in the map's frame
    *columns_of(
        WORLD,
        _OF,
        ("x", "double", "{a}.pose[1]"),
        ("y", "double", "{a}.pose[2]"),
        ("z", "double", "{a}.pose[3]"),
        ("yaw", "double", "pose_yaw({a}.pose)"),
        ("lowest", "double", "ST_ZMin({a}.box)"),
        ("highest", "double", "ST_ZMax({a}.box)"),
        ("onStorey", "entity", "{a}.storey_id"),
    ),
    *columns_of(
        SHAPED_OBJECT,
        _OF,
        ("boxWidth", "double", "(sides_of({a}.footprint))[1]"),
        ("boxLength", "double", "(sides_of({a}.footprint))[2]"),
        ("boxHeight", "double", "ST_ZMax({a}.box) - ST_ZMin({a}.box)"),
        ("graspWidth", "double", "least_width({a}.footprint)"),
    ),
    *_geometries(),
    # The building
    *columns_of(
        ROOM,
        _OF,
        ("floor", "double", "{a}.floor"),
        ("ceiling", "double", "{a}.ceiling"),
        ("cabinOf", "entity", "{a}.elevator_id"),
    ),
    *columns_of(
        STOREY,
        _OF,
        ("elevation", "double", "{a}.elevation"),
        ("clearHeight", "double", "{a}.height"),
    ),
    *columns_of(
        CONNECTOR,
        _OF,
        ("connectsFrom", "entity", "{a}.place_a"),
        ("connectsTo", "entity", "{a}.place_b"),
        ("connects", "entity", "{a}.place_a"),
        ("form", "string", "{a}.form"),
        ("state", "string", "{a}.state"),
        ("direction", "string", "{a}.direction"),
        ("behaviour", "string", "{a}.behaviour"),
        ("passageWidth", "double", "{a}.width"),
        ("passageHeight", "double", "{a}.height"),
    ),
    TripleMap(f"{SEMMAP}connects", OTHER_SIDE, _OF, _SIDE_B),
    TripleMap(f"{BOT}interfaceOf", CONNECTOR, _OF, _SIDE_A),
    TripleMap(f"{BOT}interfaceOf", OTHER_SIDE, _OF, _SIDE_B),
    *columns_of(REGION, _OF, ("partOf", "entity", "{a}.of_id"), ("origin", "string", "{a}.origin")),
    TripleMap(
        f"{SEMMAP}hasModel",
        TripleTables(
            ("entity_model", "entity"),
            (
                "{b}.id = {a}.entity_id",
                "({a}.role = 'visual' OR NOT EXISTS (SELECT FROM entity_model v WHERE v.role = "
                "'visual' AND v.entity_id = {a}.entity_id AND v.model_id = {a}.model_id))",
            ),
            "{b}.map_id",
        ),
        _OF,
        Value("model", "{a}.model_id"),
    ),
    *columns_of(
        MODEL,
        _MODEL,
        ("modelKind", "string", "{a}.kind"),
        ("uri", "string", "{a}.uri"),
        ("triangles", "integer", "{a}.triangles"),
    ),
    # Beliefs, observations, and where entities were
    TripleMap(f"{SEMMAP}hasBelief", BELIEF, _OF, _BELIEF),
    *columns_of(
        BELIEF,
        _BELIEF,
        ("place", "entity", "{a}.place_id"),
        ("probability", "double", "{a}.probability"),
        ("prior", "double", "{a}.prior"),
        ("at", "time", "{a}.at"),
    ),
    TripleMap(f"{SEMMAP}hasObservation", OBSERVATION, _OF, _OBSERVATION),
    *columns_of(
        OBSERVATION,
        _OBSERVATION,
        ("place", "entity", "{a}.place_id"),
        ("seen", "boolean", "{a}.seen"),
        ("visibleShare", "double", "{a}.visible"),
        ("at", "time", "{a}.at"),
        ("observer", "entity", "{a}.observer_id"),
    ),
    TripleMap(f"{SEMMAP}hasFormerPlacement", FORMER, _OF, _FORMER),
    TripleMap(
        f"{SEMMAP}formerHolder",
        TripleTables(
            ("placement_history", "entity", "entity"),
            ("{b}.id = {a}.entity_id", "{c}.id = {a}.holder_id"),
            "{b}.map_id",
        ),
        _FORMER,
        _HOLDER,
    ),
    *columns_of(
        FORMER,
        _FORMER,
        ("from", "time", "lower({a}.during)"),
        ("until", "time", "upper({a}.during)"),
        ("pose", "string", "array_to_string({a}.pose, ' ')"),  # in the frame of the holder
        ("reason", "string", "{a}.reason"),
    ),
    # The T-Box
    TripleMap(f"{RDF}type", CLASS, _TYPE, constant(f"{OWL}Class")),
    TripleMap(
        f"{RDFS}subClassOf",
        TripleTables(("type_parent",)),
        Value("type", "{a}.type"),
        Value("type", "{a}.parent"),
        shared=True,
    ),
    TripleMap(f"{RDFS}label", CLASS, _TYPE, Value("string", "{a}.label"), nullable=True),
    TripleMap(
        f"{RDFS}comment", CLASS, _TYPE, Value("string", "{a}.comment"), nullable=True, shared=True
    ),
    TripleMap(f"{SEMMAP}foundIn", FOUND_IN, _TYPE, Value("type", "{b}.place")),
    *MANIPULATION_TRIPLES,
)
"""The facts of the graph, besides `STATEMENTS`."""

_SFA = ("Equals", "Disjoint", "Intersects", "Touches", "Crosses", "Within", "Contains", "Overlaps")
_SF = {f"sf{name}": f"ST_{name}({{a}}, {{b}})" for name in _SFA}
"""GeoSPARQL 1.1, section 9; what PostGIS has a function of."""

_EH = {  # DE-9IM patterns of tables 5 and 6, with the condition that the index answers
    "ehEquals": ("{a} && {b}", "TFFFTFFFT"),
    "ehDisjoint": ("", "FF*FF****"),
    "ehMeet": ("{a} && {b}", "FT*******", "F**T*****", "F***T****"),
    "ehOverlap": ("{a} && {b}", "T*T***T**"),
    "ehCovers": ("{a} ~ {b}", "T*TFT*FF*"),
    "ehCoveredBy": ("{a} @ {b}", "TFF*TFT**"),
    "ehInside": ("{a} @ {b}", "TFF*FFT**"),
    "ehContains": ("{a} ~ {b}", "T*TFF*FF*"),
    "rcc8eq": ("{a} && {b}", "TFFFTFFFT"),
    "rcc8dc": ("", "FFTFFTTTT"),
    "rcc8ec": ("{a} && {b}", "FFTFTTTTT"),
    "rcc8po": ("{a} && {b}", "TTTTTTTTT"),
    "rcc8tppi": ("{a} ~ {b}", "TTTFTTFFT"),
    "rcc8tpp": ("{a} @ {b}", "TFFTTFTTT"),
    "rcc8ntpp": ("{a} @ {b}", "TFFTFFTTT"),
    "rcc8ntppi": ("{a} ~ {b}", "TTTFFTFFT"),
}


def _by_pattern(index: str, *patterns: str) -> str:
    matches = " OR ".join(f"ST_Relate({{a}}, {{b}}, '{pattern}')" for pattern in patterns)
    return f"{index} AND ({matches})" if index else f"({matches})"


TOPOLOGICAL: dict[str, str] = _SF | {name: _by_pattern(*rule) for name, rule in _EH.items()}
"""The topological relations of GeoSPARQL: SQL conditions of two geometries."""


SERIALIZATIONS = tuple(f"{GEO}{name}" for name in ("asWKT", "asGML", "asGeoJSON"))
SHAPE_PROPERTIES = (*SERIALIZATIONS, f"{GEO}hasGeometry", f"{GEO}hasDefaultGeometry")
"""What states the geometries of foreign features and geometries."""

_End = tuple[TripleTables, Value, str]  # rows, their terms, and a footprint or a term of a geometry

_MAP_ENDS: tuple[_End, ...] = tuple(
    (
        TripleTables(("world",), ("{a}.footprint IS NOT NULL",)),
        Value(form, "{a}.entity_id"),
        "{a}.footprint",
    )
    for form in ("entity", "footprint")
)


def _any_of(*properties: str) -> str:
    return "ANY (ARRAY[{}])".format(", ".join(f"term_id('{each}')" for each in properties))


def _lasts(statement: str) -> str:
    return _LASTS.replace("{a}", statement)


def _serialized(geometry: str, term: str) -> tuple[str, ...]:
    """Return the conditions of a statement of a geometry's literal, and of its term."""
    kinds = ", ".join(f"'{DATATYPES[form]}'" for form in ("geometry", "gml", "geojson"))
    return (
        f"{{{geometry}}}.predicate = {_any_of(*SERIALIZATIONS)}",
        _lasts(f"{{{geometry}}}"),
        f"{{{term}}}.id = {{{geometry}}}.object",
        f"{{{term}}}.tag IN ({kinds})",
    )


_DEFAULT = f"term_id('{GEO}hasDefaultGeometry')"
_STATED_ENDS: tuple[_End, ...] = (
    (
        TripleTables(("triple", "term"), _serialized("a", "b")),
        Value("resource", "{a}.subject"),
        "{b}",
    ),
    (
        TripleTables(
            ("triple", "triple", "term"),
            (
                f"{{a}}.predicate = {_any_of(f'{GEO}hasDefaultGeometry', f'{GEO}hasGeometry')}",
                f"({{a}}.predicate = {_DEFAULT} OR NOT EXISTS (SELECT FROM triple d "
                "WHERE d.map_id = {a}.map_id AND d.graph = {a}.graph "
                f"AND d.subject = {{a}}.subject AND d.predicate = {_DEFAULT} "
                f"AND {_lasts('d')}))",
                _LASTS,
                "{b}.map_id = {a}.map_id",
                "{b}.subject = {a}.object",
                *_serialized("b", "c"),
            ),
        ),
        Value("resource", "{a}.subject"),
        "{c}",
    ),
)
"""Geometries, and features with a default geometry, or else any."""


def _conditions(name: str, condition: str, a: str, b: str) -> Iterator[list[str]]:
    """Yield conditions of a relation: of boxes, which an index answers, and of the geometries.

    A footprint has those to geometries in the map's frame, and those to geometries on the earth.
    """
    terms = [each for each in (a, b) if not each.endswith(".footprint")]
    shapes = {each: f"stated_shape({each}.text, {each}.tag)" for each in terms}
    boxes = {each: f"stated_box({each}.text, {each}.tag)" for each in terms}
    has_boxes = name not in ("sfDisjoint", "ehDisjoint", "rcc8dc")  # no index finds what is apart
    if not terms:
        yield [condition.format(a=a, b=b)]
    elif len(terms) == 2:
        # no index finds pairs of the map's frame and of the earth, so that none of them is related
        near = [" = ".join(f"is_on_earth({each}.text, {each}.tag)" for each in terms)]
        near += [f"{boxes[a]} && {boxes[b]}"] * has_boxes
        other = f"alike({shapes[b]}, {shapes[a]}, {{a}}.map_id)"
        yield [*near, condition.format(a=shapes[a], b=other)]
    else:
        (term,), (footprint,) = terms, {a, b} - {*terms}
        box, placed = boxes[term], f"in_map_frame({shapes[term]}, {{a}}.map_id)"
        on_earth = [
            # the index of terms, for a row of footprints alone
            f"{box} && earth_box({footprint}, {footprint.replace('.footprint', '.map_id')})",
            f"{placed} && {footprint}",  # the index of footprints
        ]
        for named, shape, near in (
            ("NOT ", shapes[term], [f"{box} && {footprint}"]),
            ("", placed, on_earth),
        ):
            ends = {term: shape, footprint: footprint}
            related = condition.format(a=ends[a], b=ends[b])
            yield [f"{named}is_on_earth({term}.text, {term}.tag)", *near * has_boxes, related]


def _rewritten(*pairs: tuple[_End, _End]) -> Iterator[TripleMap]:
    """Yield the topological relations of features and geometries (GeoSPARQL 1.1, section 12)."""
    for (name, condition), (a, b) in product(TOPOLOGICAL.items(), pairs):
        letters = letters_from(len(a[0].tables))
        joined = (
            *a[0].where,
            *(each.format(**letters) for each in b[0].where),
            f"{letters['a']}.map_id = {{a}}.map_id",
        )
        for related in _conditions(name, condition, a[2], b[2].format(**letters)):
            source = TripleTables((*a[0].tables, *b[0].tables), (*joined, *related), "{a}.map_id")
            yield TripleMap(f"{GEO}{name}", source, a[1], b[1].placed(letters))


REWRITTEN: tuple[TripleMap, ...] = tuple(_rewritten(*product(_MAP_ENDS, _MAP_ENDS)))
"""Relations that follow from geometry: answered where a query names them, not written as facts."""

REWRITTEN_IN_GRAPHS: tuple[TripleMap, ...] = tuple(_rewritten(*product(_STATED_ENDS, _STATED_ENDS)))
"""The same of foreign features and geometries, as statements of a graph have them."""

REWRITTEN_OF_BOTH: tuple[TripleMap, ...] = tuple(
    _rewritten(*product(_MAP_ENDS, _STATED_ENDS), *product(_STATED_ENDS, _MAP_ENDS))
)
"""The same between the map's entities and foreign ones."""


def _of_surfaces(
    name: str, members: str, converse: str, reach: str = "", kept: str | None = None
) -> Computed:
    """Return a relation that is kept by its name, or as the converse of `kept`."""
    columns = "b, a" if kept else "a, b"
    return Computed(
        f"{SEMMAP}{name}",
        f"is_{name}({{a}}, {{b}}{reach and f', {reach}'})",
        f"{members}({{b}}, {reach or 0.01})",
        f"{converse}({{a}}, {reach or 0.01})",
        f"pairs_{kept or name}({{map}}) AS {{f}} ({columns})",
        kept or name,
    )


def _to_side(name: str, function: str, side: str) -> Computed:
    return Computed(
        f"{SEMMAP}{name}",
        f"is_{function}({{a}}, {{b}}, 'object')",
        f"things_{function}({{b}})",
        pairs=f"pairs_to_side({{map}}, '{side}') AS {{f}} (a, b)",
    )


COMPUTED: tuple[Computed, ...] = (
    _of_surfaces("in", "things_in", "containers_of"),
    _of_surfaces("on", "things_on", "supports_of"),
    _of_surfaces("above", "things_above", "things_under"),
    _of_surfaces("under", "things_under", "things_above", kept="above"),
    _of_surfaces("touching", "things_touching", "things_touching"),
    _of_surfaces("near", "things_near", "things_near", "1"),
    _to_side("leftOf", "left_of", "left"),
    _to_side("rightOf", "right_of", "right"),
    _to_side("inFrontOf", "in_front_of", "front"),
    _to_side("behind", "behind", "behind"),
    Computed(f"{SEMMAP}reachableFrom", "is_reachable({b}, {a})"),
)
"""Relations of surfaces (SQL functions): near is 1 m at most, sides are those of the object."""

_SHARED = frozenset(t.property for t in TRIPLES if t.shared)
_MAPPED = frozenset(t.property for t in TRIPLES if t.name is None)
_NAMED = frozenset(t.property for t in REWRITTEN) | {c.property for c in COMPUTED}
_OWN = (_MAPPED | _NAMED) - _SHARED


def is_mapped(iri: str) -> bool:
    """Return whether a property has columns of its own, so that only foreign IRIs may state it."""
    return iri in _OWN or iri.startswith((PROPERTY, RELATION))
