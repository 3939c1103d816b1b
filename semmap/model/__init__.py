"""The map as typed SQLAlchemy classes (Deeken et al., section 3); `schema/` is what they mirror."""

from semmap.model.base import Base, PoseColumn
from semmap.model.belief import (
    Belief,
    BeliefModel,
    Observation,
    TaughtAction,
    TaughtRelation,
)
from semmap.model.entity import (
    Agent,
    Connector,
    Elevator,
    Entity,
    Link,
    Map,
    Object,
    ObjectType,
    Region,
    Room,
    Storey,
)
from semmap.model.field import Field, FieldBlock, FieldVersion
from semmap.model.geometry import Chunk, EntityChunk, EntityModel, GeometricModel, SupportSurface
from semmap.model.history import (
    Change,
    EntityHistory,
    Import,
    PlacementHistory,
    Retention,
)
from semmap.model.mission import Mission, MissionStep, Reservation
from semmap.model.placement import Placement, WorldPlacement
from semmap.model.semantics import Ontology, SemanticType, TypeClosure, TypeParent
from semmap.model.topology import (
    Execution,
    RobotClassRecord,
    TravelTime,
    TravelTimeMap,
    TravelTimePlace,
)

__all__ = [
    "Agent",
    "Base",
    "Belief",
    "BeliefModel",
    "Change",
    "Chunk",
    "Connector",
    "Elevator",
    "Entity",
    "EntityChunk",
    "EntityHistory",
    "EntityModel",
    "Execution",
    "Field",
    "FieldBlock",
    "FieldVersion",
    "GeometricModel",
    "Import",
    "Link",
    "Map",
    "Mission",
    "MissionStep",
    "Object",
    "ObjectType",
    "Observation",
    "Ontology",
    "Placement",
    "PlacementHistory",
    "PoseColumn",
    "Region",
    "Reservation",
    "Retention",
    "RobotClassRecord",
    "Room",
    "SemanticType",
    "Storey",
    "SupportSurface",
    "TaughtAction",
    "TaughtRelation",
    "TravelTime",
    "TravelTimeMap",
    "TravelTimePlace",
    "TypeClosure",
    "TypeParent",
    "WorldPlacement",
]
