"""What was observed, and where things probably are."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ForeignKey, text
from sqlalchemy.orm import Mapped, mapped_column, relationship

from semmap.model.base import Base, RowId
from semmap.model.entity import Entity


class Observation(Base):
    """A look at a place: an object was seen there, or looked for and not seen.

    `position` is x, y, z in the frame of the place, `visible` the share of the place in view, and
    `distance` metres from the observer, by its pose then. With `inside`, the object was anywhere in
    the place, also on or in what the place holds.
    """

    __tablename__ = "observation"

    id: Mapped[RowId]
    entity_id: Mapped[int] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    place_id: Mapped[int] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    at: Mapped[datetime] = mapped_column(server_default=text("clock_timestamp()"))
    seen: Mapped[bool]
    inside: Mapped[bool] = mapped_column(server_default=text("false"))
    position: Mapped[list[float] | None]
    visible: Mapped[float] = mapped_column(server_default=text("1"))
    hit: Mapped[float | None]
    false_alarm: Mapped[float | None]
    observer_id: Mapped[int | None] = mapped_column(ForeignKey(Entity.id, ondelete="SET NULL"))
    distance: Mapped[float | None]

    entity: Mapped[Entity] = relationship(foreign_keys=entity_id)
    place: Mapped[Entity] = relationship(foreign_keys=place_id)


class Belief(Base):
    """How probable it is that an entity is at a place, elsewhere without one. Kept by triggers."""

    __tablename__ = "belief"

    id: Mapped[RowId]
    entity_id: Mapped[int] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    place_id: Mapped[int | None] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    prior: Mapped[float]
    probability: Mapped[float]
    at: Mapped[datetime]

    entity: Mapped[Entity] = relationship(foreign_keys=entity_id)
    place: Mapped[Entity | None] = relationship(foreign_keys=place_id)
