"""What robots know of manipulation (Tosello, Fan and Pagello, section III)."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import (
    Computed,
    ForeignKey,
    Identity,
    Integer,
    LargeBinary,
    text,
)
from sqlalchemy.orm import Mapped, mapped_column, relationship

from semmap.geometry.pose import Pose
from semmap.model.base import Base, EntityKey, RowId
from semmap.model.entity import Entity, StoredMap
from semmap.model.semantics import SemanticType

OWN = text("1")
NOW = text("clock_timestamp()")
EMPTY = text("'{}'")


class Contributor(Base):
    """Where knowledge comes from: this database, simulation, or the signer of a bundle.

    Outcomes count by the trust in their contributor, 0 to 1.
    """

    __tablename__ = "contributor"

    id: Mapped[int] = mapped_column(Integer, Identity(), primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    key: Mapped[bytes | None] = mapped_column(LargeBinary, unique=True)
    trust: Mapped[float] = mapped_column(server_default=OWN)
    latest: Mapped[datetime | None]


class Device(Base):
    """A robot, gripper or sensor: its URDF, joint limits and capabilities."""

    __tablename__ = "device"

    id: Mapped[int] = mapped_column(Integer, Identity(), primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    kind: Mapped[str]
    urdf: Mapped[str | None]
    source: Mapped[str | None]
    joints: Mapped[dict[str, Any]] = mapped_column(server_default=EMPTY)
    capabilities: Mapped[list[str]] = mapped_column(server_default=EMPTY)


class StoredGripper(Base):
    """A device that grips: how wide it opens and how deep its fingers are, metres.

    `swept` is the volume that its fingers pass while they close, m³, and `force` that of the vacuum
    of a suction cup, newtons.
    """

    __tablename__ = "gripper"

    device_id: Mapped[int] = mapped_column(
        ForeignKey(Device.id, ondelete="CASCADE"), primary_key=True
    )
    form: Mapped[str]
    opening: Mapped[float]
    depth: Mapped[float]
    swept: Mapped[float | None]
    force: Mapped[float | None]
    preferred: Mapped[bool] = mapped_column(server_default=text("false"))

    device: Mapped[Device] = relationship()


class ObjectModel(Base):
    """What all objects of the same meshes share: functions, shape, actions; or a shape alone.

    `size` is (radius) of a sphere, (radius, height) of a cylinder or cone, (x, y, z) of a cuboid.
    """

    __tablename__ = "object_model"

    id: Mapped[RowId]
    key: Mapped[str] = mapped_column(unique=True)
    name: Mapped[str | None]
    type: Mapped[str | None] = mapped_column(
        ForeignKey(SemanticType.name, onupdate="CASCADE", ondelete="SET NULL")
    )
    functions: Mapped[list[str]] = mapped_column(server_default=EMPTY)
    shape: Mapped[str | None]
    size: Mapped[list[float] | None]
    shape_pose: Mapped[Pose | None]
    inliers: Mapped[float | None]
    deviation: Mapped[list[float] | None]
    contributor_id: Mapped[int] = mapped_column(ForeignKey(Contributor.id), server_default=OWN)

    actions: Mapped[list[StoredAction]] = relationship(back_populates="object")


class EntityObject(Base):
    """The object model of an entity, as its meshes say; triggers write it."""

    __tablename__ = "entity_object"

    entity_id: Mapped[EntityKey]
    object_id: Mapped[int] = mapped_column(ForeignKey(ObjectModel.id, ondelete="CASCADE"))


class StoredAction(Base):
    """How a gripper acts on an object model; poses of its grasp frame in the model's frame.

    `kind` is grasp, place, push, turn, open or put. `expected` is the expected share of successes.
    """

    __tablename__ = "action"

    id: Mapped[RowId]
    key: Mapped[UUID] = mapped_column(unique=True, server_default=text("gen_random_uuid()"))
    kind: Mapped[str]
    object_id: Mapped[int] = mapped_column(ForeignKey(ObjectModel.id, ondelete="CASCADE"))
    gripper_id: Mapped[int] = mapped_column(ForeignKey(StoredGripper.device_id, ondelete="CASCADE"))
    pose: Mapped[Pose | None]
    pre_pose: Mapped[Pose | None]
    post_pose: Mapped[Pose | None]
    motion: Mapped[list[float] | None]
    approach: Mapped[str | None]
    family: Mapped[str | None]
    width: Mapped[float | None]
    posture: Mapped[dict[str, Any]] = mapped_column(server_default=EMPTY)
    pre_posture: Mapped[dict[str, Any]] = mapped_column(server_default=EMPTY)
    quality: Mapped[float] = mapped_column(server_default=text("0.5"))
    attempts: Mapped[float] = mapped_column(server_default=text("0"))
    successes: Mapped[float] = mapped_column(server_default=text("0"))
    expected: Mapped[float] = mapped_column(
        Computed("(successes + 2 * quality) / (attempts + 2)", persisted=True)
    )
    replaced_by: Mapped[int | None] = mapped_column(
        ForeignKey("semmap.action.id", ondelete="SET NULL")
    )
    shift: Mapped[list[float] | None]
    contributor_id: Mapped[int] = mapped_column(ForeignKey(Contributor.id), server_default=OWN)
    created_at: Mapped[datetime] = mapped_column(server_default=NOW)

    object: Mapped[ObjectModel] = relationship(back_populates="actions")
    gripper: Mapped[StoredGripper] = relationship()
    contributor: Mapped[Contributor] = relationship()


class ManipulationTask(Base):
    """A manipulation that a robot shall do, does or did, and its outcome."""

    __tablename__ = "task"

    id: Mapped[RowId]
    map_id: Mapped[int] = mapped_column(ForeignKey(StoredMap.id, ondelete="CASCADE"))
    robot_id: Mapped[int | None] = mapped_column(ForeignKey(Entity.id, ondelete="SET NULL"))
    kind: Mapped[str]
    entity_id: Mapped[int | None] = mapped_column(ForeignKey(Entity.id, ondelete="SET NULL"))
    action_id: Mapped[int | None] = mapped_column(ForeignKey(StoredAction.id, ondelete="SET NULL"))
    start: Mapped[Pose | None]
    goal: Mapped[Pose | None]
    deadline: Mapped[datetime | None]
    outcome: Mapped[str] = mapped_column(server_default=text("'to run'"))
    message: Mapped[str | None]
    contributor_id: Mapped[int] = mapped_column(ForeignKey(Contributor.id), server_default=OWN)
    created_at: Mapped[datetime] = mapped_column(server_default=NOW)
    ended_at: Mapped[datetime | None]

    entity: Mapped[Entity | None] = relationship(foreign_keys=entity_id)
    action: Mapped[StoredAction | None] = relationship()
