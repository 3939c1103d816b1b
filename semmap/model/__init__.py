"""The map as typed SQLAlchemy classes (Deeken et al., section 3); `schema/` is what they mirror.

Tables that only the programs read and write have no class; SQL reaches them all. Indexes are the
schema's alone.
"""

from semmap.model.base import Base as Base
from semmap.model.base import PoseColumn as PoseColumn
from semmap.model.belief import Belief as Belief
from semmap.model.belief import Observation as Observation
from semmap.model.entity import Agent as Agent
from semmap.model.entity import Connector as Connector
from semmap.model.entity import Elevator as Elevator
from semmap.model.entity import Entity as Entity
from semmap.model.entity import EntityModel as EntityModel
from semmap.model.entity import GeometricModel as GeometricModel
from semmap.model.entity import Link as Link
from semmap.model.entity import Object as Object
from semmap.model.entity import ObjectType as ObjectType
from semmap.model.entity import Region as Region
from semmap.model.entity import Room as Room
from semmap.model.entity import StoredMap as StoredMap
from semmap.model.entity import Storey as Storey
from semmap.model.history import EntityHistory as EntityHistory
from semmap.model.history import PlacementHistory as PlacementHistory
from semmap.model.manipulation import Contributor as Contributor
from semmap.model.manipulation import Device as Device
from semmap.model.manipulation import EntityObject as EntityObject
from semmap.model.manipulation import ManipulationTask as ManipulationTask
from semmap.model.manipulation import ObjectModel as ObjectModel
from semmap.model.manipulation import StoredAction as StoredAction
from semmap.model.manipulation import StoredGripper as StoredGripper
from semmap.model.mission import Mission as Mission
from semmap.model.mission import MissionStep as MissionStep
from semmap.model.placement import Placement as Placement
from semmap.model.placement import WorldPlacement as WorldPlacement
from semmap.model.semantics import SemanticType as SemanticType
from semmap.model.semantics import TypeParent as TypeParent

__all__ = [name for name in globals() if name[0].isupper()]
