"""Classes of robots, and how long travel and behaviours take them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, Computed, ForeignKey, Identity, Index, Integer, Text, text
from sqlalchemy.dialects.postgresql import ARRAY, DOUBLE_PRECISION, JSONB
from sqlalchemy.orm import Mapped, mapped_column

from semmap.model.base import Base
from semmap.model.entity import Connector, Entity, StoredMap

__all__ = ["Execution", "RobotClassRecord", "TravelTime", "TravelTimeMap", "TravelTimePlace"]


class RobotClassRecord(Base):
    """Properties that decide where robots can go and how long that takes.

    Metres, radians, seconds. `width` and `height` are those of the widest and the highest part;
    None without a shape.
    """

    __tablename__ = "robot_class"

    id: Mapped[int] = mapped_column(Integer, Identity(), primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    urdf: Mapped[str | None]
    parts: Mapped[list[Any]] = mapped_column(JSONB, server_default=text("'[]'"))
    width: Mapped[float | None]
    height: Mapped[float | None]
    max_step: Mapped[float]
    max_slope: Mapped[float]
    speed: Mapped[float]
    behaviours: Mapped[list[str] | None] = mapped_column(ARRAY(Text))
    permissions: Mapped[list[str]] = mapped_column(ARRAY(Text), server_default=text("'{}'"))
    opens: Mapped[bool] = mapped_column(server_default=text("true"))
    unlocks: Mapped[bool] = mapped_column(server_default=text("false"))
    outside: Mapped[bool] = mapped_column(server_default=text("false"))
    reach: Mapped[list[float]] = mapped_column(ARRAY(DOUBLE_PRECISION))
    heights: Mapped[list[float]] = mapped_column(ARRAY(DOUBLE_PRECISION))
    capacity: Mapped[int]
    call_seconds: Mapped[float]
    ride_seconds: Mapped[float]
    ride_seconds_per_metre: Mapped[float]
    open_seconds: Mapped[float]
    unlock_seconds: Mapped[float]
    pickup_seconds: Mapped[float]
    place_seconds: Mapped[float]


class TravelTime(Base):
    """Travel in a place between the approach poses of two connectors; infinite without a path."""

    __tablename__ = "travel_time"
    __table_args__ = (
        Index("travel_time_in", "place_id"),
        Index("travel_time_from", "from_id"),
        Index("travel_time_to", "to_id"),
    )

    robot_class_id: Mapped[int] = mapped_column(
        ForeignKey(RobotClassRecord.id, ondelete="CASCADE"), primary_key=True
    )
    place_id: Mapped[int] = mapped_column(
        ForeignKey(Entity.id, ondelete="CASCADE"), primary_key=True
    )
    from_id: Mapped[int] = mapped_column(
        ForeignKey(Connector.entity_id, ondelete="CASCADE"), primary_key=True
    )
    to_id: Mapped[int] = mapped_column(
        ForeignKey(Connector.entity_id, ondelete="CASCADE"), primary_key=True
    )
    seconds: Mapped[float]
    metres: Mapped[float]
    packed: Mapped[bytes | None] = mapped_column(
        Computed(
            "int8send(place_id) || int8send(from_id) || int8send(to_id) "
            "|| float8send(seconds) || float8send(metres)"
        )
    )


class TravelTimePlace(Base):
    """The state of a place in which its travel times were measured."""

    __tablename__ = "travel_time_place"
    __table_args__ = (Index("travel_time_place_of", "place_id"),)

    robot_class_id: Mapped[int] = mapped_column(
        ForeignKey(RobotClassRecord.id, ondelete="CASCADE"), primary_key=True
    )
    place_id: Mapped[int] = mapped_column(
        ForeignKey(Entity.id, ondelete="CASCADE"), primary_key=True
    )
    digest: Mapped[str]


class TravelTimeMap(Base):
    """The last change of a map that its travel times take into account."""

    __tablename__ = "travel_time_map"

    robot_class_id: Mapped[int] = mapped_column(
        ForeignKey(RobotClassRecord.id, ondelete="CASCADE"), primary_key=True
    )
    map_id: Mapped[int] = mapped_column(
        ForeignKey(StoredMap.id, ondelete="CASCADE"), primary_key=True
    )
    cursor: Mapped[str]


class Execution(Base):
    """How long a behaviour took at a connector or an elevator, and whether it succeeded."""

    __tablename__ = "execution"
    __table_args__ = (
        Index("execution_of", "robot_class_id", "behaviour", "entity_id"),
        Index("execution_entity", "entity_id"),
    )

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    robot_class_id: Mapped[int | None] = mapped_column(
        ForeignKey(RobotClassRecord.id, ondelete="CASCADE")
    )
    behaviour: Mapped[str]
    entity_id: Mapped[int] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    at: Mapped[datetime] = mapped_column(server_default=text("clock_timestamp()"))
    seconds: Mapped[float]
    height: Mapped[float] = mapped_column(server_default=text("0"))
    succeeded: Mapped[bool]
