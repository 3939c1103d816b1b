"""The map as typed SQLAlchemy classes (Deeken et al., section 3); `schema/` is what they mirror.

Tables that only the programs read and write have no class; SQL reaches them all. Indexes are the
schema's alone.
"""

from semmap.model.base import Base, PoseColumn
from semmap.model.belief import Belief, Observation
from semmap.model.entity import (
    Agent,
    Connector,
    Elevator,
    Entity,
    EntityModel,
    GeometricModel,
    Link,
    Object,
    ObjectType,
    Region,
    Room,
    StoredMap,
    Storey,
)
from semmap.model.history import EntityHistory, PlacementHistory
from semmap.model.manipulation import (
    Contributor,
    Device,
    EntityObject,
    ManipulationTask,
    ObjectModel,
    StoredAction,
    StoredGripper,
)
from semmap.model.mission import Mission, MissionStep
from semmap.model.placement import Placement, WorldPlacement
from semmap.model.semantics import SemanticType, TypeParent

__all__ = [
    "Agent",
    "Base",
    "Belief",
    "Connector",
    "Contributor",
    "Device",
    "Elevator",
    "Entity",
    "EntityHistory",
    "EntityModel",
    "EntityObject",
    "GeometricModel",
    "Link",
    "ManipulationTask",
    "Mission",
    "MissionStep",
    "Object",
    "ObjectModel",
    "ObjectType",
    "Observation",
    "Placement",
    "PlacementHistory",
    "PoseColumn",
    "Region",
    "Room",
    "SemanticType",
    "StoredAction",
    "StoredGripper",
    "StoredMap",
    "Storey",
    "TypeParent",
    "WorldPlacement",
]
