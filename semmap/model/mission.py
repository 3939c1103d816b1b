"""Goals that robots pursue, the outcome of each step, and reservations of connectors."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, text
from sqlalchemy.orm import Mapped, mapped_column

from semmap.model.base import Base, RowId
from semmap.model.entity import Entity, StoredMap


class Mission(Base):
    """A goal of a robot, and whether it reached it: waiting, running, done, failed or cancelled.

    `runner` is the process that runs it, `heartbeat` the last sign of life of that process.
    """

    __tablename__ = "mission"

    id: Mapped[RowId]
    map_id: Mapped[int] = mapped_column(ForeignKey(StoredMap.id, ondelete="CASCADE"))
    robot_id: Mapped[int] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    goal: Mapped[str]
    state: Mapped[str] = mapped_column(server_default="waiting", default="waiting")
    reason: Mapped[str | None]
    runner: Mapped[str | None]
    created_at: Mapped[datetime] = mapped_column(server_default=text("now()"))
    heartbeat: Mapped[datetime | None]
    ended_at: Mapped[datetime | None]


class MissionStep(Base):
    """One behaviour of a mission: planned, started, done or failed, with its own message."""

    __tablename__ = "mission_step"

    mission_id: Mapped[int] = mapped_column(
        ForeignKey(Mission.id, ondelete="CASCADE"), primary_key=True
    )
    number: Mapped[int] = mapped_column(primary_key=True)
    action: Mapped[str]
    arguments: Mapped[list[str]]
    command: Mapped[dict[str, Any]]
    state: Mapped[str] = mapped_column(server_default="planned", default="planned")
    started_at: Mapped[datetime | None]
    ended_at: Mapped[datetime | None]
    cause: Mapped[str | None]
    message: Mapped[str | None]
