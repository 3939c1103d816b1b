"""Former versions with their time span."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger
from sqlalchemy.dialects.postgresql import TSTZRANGE, Range
from sqlalchemy.orm import Mapped, mapped_column

from semmap.geometry.pose import Pose
from semmap.model.base import Base


class EntityHistory(Base):
    """The former state of an entity, and during which time it was valid."""

    __tablename__ = "entity_history"
    __mapper_args__ = {"primary_key": ["entity_id", "during"]}  # noqa: RUF012

    entity_id: Mapped[int] = mapped_column(BigInteger)
    map_id: Mapped[int]
    kind: Mapped[str]
    name: Mapped[str]
    label: Mapped[str | None]
    type: Mapped[str | None]
    properties: Mapped[dict[str, Any]]
    front: Mapped[float]
    during: Mapped[Range[datetime]] = mapped_column(TSTZRANGE)
    ended: Mapped[bool] = mapped_column(server_default="false", default=False)


class PlacementHistory(Base):
    """Where an entity was, and during which time.

    `reason` tells why a version ended that no writer ended: the geometry showed another holder.
    """

    __tablename__ = "placement_history"
    __mapper_args__ = {"primary_key": ["entity_id", "during"]}  # noqa: RUF012

    entity_id: Mapped[int] = mapped_column(BigInteger)
    holder_id: Mapped[int | None] = mapped_column(BigInteger)
    pose: Mapped[Pose]
    relation: Mapped[str]
    confidence: Mapped[float | None]
    during: Mapped[Range[datetime]] = mapped_column(TSTZRANGE)
    reason: Mapped[str | None]
