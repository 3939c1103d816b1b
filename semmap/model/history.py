"""Former versions with their time span, what changed when, and what was imported."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import BigInteger, ForeignKey, Identity, Index, Interval, text
from sqlalchemy.dialects.postgresql import JSONB, TSTZRANGE, Range
from sqlalchemy.orm import Mapped, mapped_column

from semmap.geometry.pose import Pose
from semmap.model.base import Base, PoseColumn
from semmap.model.entity import StoredMap

__all__ = ["Change", "ChangePruned", "EntityHistory", "Import", "PlacementHistory", "Retention"]


class EntityHistory(Base):
    """The former state of an entity, and during which time it was valid."""

    __tablename__ = "entity_history"
    __table_args__ = (
        Index("entity_history_entity", "entity_id", text("lower(during)")),
        Index("entity_history_name", "map_id", "name"),
        Index("entity_history_ended", text("upper(during)"), postgresql_where=text("ended")),
    )
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
    __table_args__ = (Index("placement_history_entity", "entity_id", text("lower(during)")),)
    __mapper_args__ = {"primary_key": ["entity_id", "during"]}  # noqa: RUF012

    entity_id: Mapped[int] = mapped_column(BigInteger)
    holder_id: Mapped[int | None] = mapped_column(BigInteger)
    pose: Mapped[Pose] = mapped_column(PoseColumn)
    relation: Mapped[str]
    confidence: Mapped[float | None]
    during: Mapped[Range[datetime]] = mapped_column(TSTZRANGE)
    reason: Mapped[str | None]


class Retention(Base):
    """How much history of a kind of entity is kept: a placement per `keep_every`, up to `keep_for`.

    The kind ``change`` is for rows of `Change`. Writers apply it as they go.
    """

    __tablename__ = "retention"

    kind: Mapped[str] = mapped_column(primary_key=True)
    keep_every: Mapped[timedelta | None] = mapped_column(Interval)
    keep_for: Mapped[timedelta | None] = mapped_column(Interval)


class Change(Base):
    """What a statement changed: one row each, announced once a transaction."""

    __tablename__ = "change"
    __table_args__ = (Index("change_xid", "xid"),)

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    xid: Mapped[int] = mapped_column(
        BigInteger, server_default=text("(pg_current_xact_id()::text)::bigint")
    )
    at: Mapped[datetime] = mapped_column(server_default=text("clock_timestamp()"))
    map_id: Mapped[int]
    what: Mapped[str]
    entities: Mapped[list[int]]
    facts: Mapped[Any | None] = mapped_column(JSONB())


class ChangePruned(Base):
    """The newest transaction of which a change was pruned: older cursors have missed changes."""

    __tablename__ = "change_pruned"

    id: Mapped[int] = mapped_column(primary_key=True, server_default="1", autoincrement=False)
    xid: Mapped[int] = mapped_column(BigInteger)


class Import(Base):
    """A file as it was imported: repeating it changes nothing."""

    __tablename__ = "import"
    __table_args__ = (Index("import_map", "map_id", "source"),)

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    map_id: Mapped[int] = mapped_column(ForeignKey(StoredMap.id, ondelete="CASCADE"))
    source: Mapped[str]
    digest: Mapped[str]
    at: Mapped[datetime] = mapped_column(server_default=text("now()"))
    summary: Mapped[dict[str, Any]]
