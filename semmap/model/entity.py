"""Maps and their entries: rooms, objects, regions, connectors, elevators, storeys, agents."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from geoalchemy2 import Geometry
from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Double,
    ForeignKey,
    Identity,
    Integer,
    PrimaryKeyConstraint,
    UniqueConstraint,
    exists,
    text,
)
from sqlalchemy.dialects.postgresql import ARRAY, JSONB, TSTZRANGE, Range
from sqlalchemy.ext.associationproxy import AssociationProxy, association_proxy
from sqlalchemy.ext.mutable import MutableDict
from sqlalchemy.orm import Mapped, mapped_column, relationship

from semmap.geometry.pose import Pose
from semmap.model.base import Base, EntityKey, RowId
from semmap.model.placement import Placement, WorldPlacement
from semmap.model.semantics import SemanticType


class GeometricModel(Base):
    """A mesh, box, point cloud, polygon or CAD reference, in its own frame (metres).

    `hull` are the corners of the convex hull, from which the exact extents follow however the
    model is turned; `outline` is the footprint of the upright model where it is known.
    """

    __tablename__ = "model"

    id: Mapped[RowId]
    digest: Mapped[str] = mapped_column(unique=True)
    kind: Mapped[str]
    uri: Mapped[str | None]
    triangles: Mapped[int]
    closed: Mapped[bool | None]
    hull: Mapped[Any] = mapped_column(Geometry("MULTIPOINTZ", dimension=3, spatial_index=False))
    outline: Mapped[Any | None] = mapped_column(Geometry("MULTIPOLYGON", spatial_index=False))


class EntityModel(Base):
    """That an entity has a model, to be seen (`visual`) or to be bumped into (`collision`)."""

    __tablename__ = "entity_model"

    entity_id: Mapped[EntityKey]
    model_id: Mapped[int] = mapped_column(ForeignKey(GeometricModel.id), primary_key=True)
    role: Mapped[str] = mapped_column(server_default="visual", default="visual", primary_key=True)


class StoredMap(Base):
    """A local metric frame and all that is in it; optionally placed on the earth.

    `crs` (EPSG code), `easting`, `northing`, `height` (metres) say where the origin lies,
    `rotation` how far the map's x axis is turned from east (radians, counter-clockwise):
    all of them or none.
    """

    __tablename__ = "map"

    id: Mapped[int] = mapped_column(Integer, Identity(), primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    created_at: Mapped[datetime] = mapped_column(server_default=text("now()"))
    crs: Mapped[int | None]
    easting: Mapped[float | None]
    northing: Mapped[float | None]
    height: Mapped[float | None]
    rotation: Mapped[float | None]
    copy_of: Mapped[int | None] = mapped_column(ForeignKey("map.id", ondelete="CASCADE"))

    entities: Mapped[list[Entity]] = relationship(viewonly=True)


class Entity(Base):
    """An entry of the map: a name, and a geometric, semantic and topological part (section 3.3).

    Any of the parts may be empty: no models, no type, no placement or links. `front` is the heading
    of the entity's front in its own frame, radians from its x axis.
    """

    __tablename__ = "entity"
    __table_args__: Any = (UniqueConstraint("map_id", "name", name="entity_map_id_name_key"),)
    __mapper_args__ = {"polymorphic_on": "kind"}  # noqa: RUF012

    id: Mapped[RowId]
    map_id: Mapped[int] = mapped_column(ForeignKey(StoredMap.id, ondelete="CASCADE"))
    kind: Mapped[str]
    name: Mapped[str]
    label: Mapped[str | None]
    type: Mapped[str | None] = mapped_column(ForeignKey(SemanticType.name, onupdate="CASCADE"))
    properties: Mapped[dict[str, Any]] = mapped_column(
        MutableDict.as_mutable(JSONB()), server_default="{}", default=dict
    )
    front: Mapped[float] = mapped_column(Double, server_default="0", default=0.0)
    source: Mapped[str | None]
    digest: Mapped[str | None]
    since: Mapped[datetime] = mapped_column(server_default=text("statement_timestamp()"))

    map: Mapped[StoredMap] = relationship()
    placement: Mapped[Placement | None] = relationship(
        foreign_keys=Placement.entity_id, back_populates="entity", passive_deletes=True
    )
    world: Mapped[WorldPlacement | None] = relationship(
        primaryjoin=lambda: Entity.id == WorldPlacement.entity_id,
        foreign_keys=WorldPlacement.entity_id,
        viewonly=True,
        uselist=False,
    )
    models: Mapped[list[GeometricModel]] = relationship(
        secondary=EntityModel.__table__, passive_deletes=True
    )
    holder: AssociationProxy[Entity | None] = association_proxy("placement", "holder")
    contents: Mapped[list[Entity]] = relationship(
        secondary=Placement.__table__,
        primaryjoin=lambda: Entity.id == Placement.holder_id,
        secondaryjoin=lambda: Entity.id == Placement.entity_id,
        viewonly=True,
    )

    @classmethod
    def is_a(cls, type_name: str) -> ColumnElement[bool]:
        """The condition that an entity is of a semantic type or of one of its subtypes.

        Examples
        --------
        >>> from sqlalchemy import select
        >>> from semmap.model import Object
        >>> furniture = select(Object).where(Object.is_a("furniture"))
        """
        return exists().where(
            ObjectType.id == cls.id,
            ObjectType.map_id == cls.map_id,
            ObjectType.type == type_name,
        )

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"


class Object(Entity):
    """Furniture, walls, muffins: what stands or lies in the environment."""

    __mapper_args__ = {"polymorphic_identity": "object"}  # noqa: RUF012


class Agent(Entity):
    """A robot or a person."""

    __mapper_args__ = {"polymorphic_identity": "agent"}  # noqa: RUF012


class Storey(Entity):
    """A level of a building: its elevation above the map's origin and clear height, metres."""

    __tablename__ = "storey"
    __mapper_args__ = {"polymorphic_identity": "storey"}  # noqa: RUF012

    entity_id: Mapped[EntityKey]
    elevation: Mapped[float] = mapped_column(server_default="0", default=0.0)
    height: Mapped[float | None]


class Elevator(Entity):
    """An elevator; its cabin is a room per storey (``elevator-1st``, ``elevator-3rd``)."""

    __tablename__ = "elevator"
    __mapper_args__ = {"polymorphic_identity": "elevator"}  # noqa: RUF012

    entity_id: Mapped[EntityKey]
    cabins: Mapped[list[Room]] = relationship(
        back_populates="elevator",
        primaryjoin=lambda: Elevator.entity_id == Room.elevator_id,
        foreign_keys=lambda: Room.elevator_id,
        passive_deletes=True,
    )


class Room(Entity):
    """A place: floor and ceiling are heights in its own frame, metres."""

    __tablename__ = "room"

    entity_id: Mapped[int] = mapped_column(
        BigInteger, ForeignKey(Entity.id, ondelete="CASCADE"), primary_key=True
    )
    floor: Mapped[float] = mapped_column(server_default="0", default=0.0)
    ceiling: Mapped[float | None]
    elevator_id: Mapped[int | None] = mapped_column(
        ForeignKey(Elevator.entity_id, ondelete="SET NULL")
    )
    __mapper_args__ = {  # noqa: RUF012
        "polymorphic_identity": "room",
        "inherit_condition": entity_id == Entity.id,
    }

    elevator: Mapped[Elevator | None] = relationship(
        back_populates="cabins",
        primaryjoin=lambda: Elevator.entity_id == Room.elevator_id,
        foreign_keys=elevator_id,
    )


class Connector(Entity):
    """A door, elevator door, stairs or ramp that joins two places (section 3.4).

    `place_b` is None where the connector leads outside. `pose_a` and `pose_b` are given in the
    connector's own frame: where a robot stands in either place, facing the connector; x of the
    frame points from `place_a` to `place_b`. `behaviour` names the robot behaviour that passing
    needs, `permissions` of what a robot needs one. `width` and `height` are of the clear opening,
    `step` is that of its threshold, metres. `seen_at` is when its state was last found to be so.
    """

    __tablename__ = "connector"

    entity_id: Mapped[int] = mapped_column(
        BigInteger, ForeignKey(Entity.id, ondelete="CASCADE"), primary_key=True
    )
    form: Mapped[str] = mapped_column(server_default="door", default="door")
    place_a_id: Mapped[int] = mapped_column("place_a", ForeignKey(Entity.id, ondelete="CASCADE"))
    place_b_id: Mapped[int | None] = mapped_column(
        "place_b", ForeignKey(Entity.id, ondelete="CASCADE")
    )
    pose_a: Mapped[Pose]
    pose_b: Mapped[Pose]
    direction: Mapped[str] = mapped_column(server_default="both", default="both")
    state: Mapped[str] = mapped_column(server_default="open", default="open")
    behaviour: Mapped[str] = mapped_column(server_default="pass_door", default="pass_door")
    width: Mapped[float | None]
    height: Mapped[float | None]
    step: Mapped[float] = mapped_column(server_default="0", default=0.0)
    permissions: Mapped[list[str]] = mapped_column(server_default=text("'{}'"), default=list)
    seen_at: Mapped[datetime | None]
    __mapper_args__ = {  # noqa: RUF012
        "polymorphic_identity": "connector",
        "inherit_condition": entity_id == Entity.id,
    }

    place_a: Mapped[Entity] = relationship(
        foreign_keys=place_a_id, primaryjoin=lambda: Connector.place_a_id == Entity.id
    )
    place_b: Mapped[Entity | None] = relationship(
        foreign_keys=place_b_id, primaryjoin=lambda: Connector.place_b_id == Entity.id
    )


class Region(Entity):
    """A part of a room's or object's geometry with a meaning of its own (section 3.4).

    Drawn (it has a model), or a subset of the faces of a model: `faces` are indices into the
    triangles of `model_id`, in the order of its chunks. `valid` says when the region holds.
    """

    __tablename__ = "region"

    entity_id: Mapped[int] = mapped_column(
        BigInteger, ForeignKey(Entity.id, ondelete="CASCADE"), primary_key=True
    )
    of_id: Mapped[int | None] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    model_id: Mapped[int | None] = mapped_column(ForeignKey(GeometricModel.id))
    faces: Mapped[list[int] | None] = mapped_column(ARRAY(Integer))
    origin: Mapped[str] = mapped_column(server_default="drawn", default="drawn")
    valid: Mapped[Range[datetime] | None] = mapped_column(TSTZRANGE)
    __mapper_args__ = {  # noqa: RUF012
        "polymorphic_identity": "region",
        "inherit_condition": entity_id == Entity.id,
    }

    of: Mapped[Entity | None] = relationship(
        foreign_keys=of_id, primaryjoin=lambda: Region.of_id == Entity.id
    )


class Link(Base):
    """A named relation between two entities (section 3.3, A3)."""

    __tablename__ = "link"

    from_id: Mapped[int] = mapped_column(
        ForeignKey(Entity.id, ondelete="CASCADE"), primary_key=True
    )
    relation: Mapped[str] = mapped_column(primary_key=True)
    to_id: Mapped[int] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"), primary_key=True)
    properties: Mapped[dict[str, Any]] = mapped_column(server_default="{}", default=dict)


class ObjectType(Base):
    """An entity under each of its supertypes; kept by triggers, the view `object` shows it."""

    __tablename__ = "object_type"
    __table_args__: Any = (
        PrimaryKeyConstraint("map_id", "type", "id", postgresql_include=["label"]),
    )

    map_id: Mapped[int]
    type: Mapped[str]
    id: Mapped[int] = mapped_column(BigInteger)
    label: Mapped[str]
