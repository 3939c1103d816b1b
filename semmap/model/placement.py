"""Where an entity is: its holder and its pose relative to it, and the world coordinates."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any

from geoalchemy2 import Geometry
from sqlalchemy import BigInteger, ForeignKey, event, inspect, text
from sqlalchemy.orm import Mapped, mapped_column, relationship

from semmap.geometry.pose import IDENTITY, Pose
from semmap.model.base import Base, EntityKey

if TYPE_CHECKING:
    from semmap.model.entity import Entity


class Placement(Base):
    """One row an entity: inventory and frame at once, so that they cannot disagree.

    `holder` is None where the map itself holds the entity; `pose` is relative to the holder.
    `confidence` (0..1) is that of a holder derived from geometry, None where somebody stated it.
    """

    __tablename__ = "placement"

    entity_id: Mapped[EntityKey]
    holder_id: Mapped[int | None] = mapped_column(ForeignKey("semmap.entity.id"))
    pose: Mapped[Pose] = mapped_column(server_default="{0,0,0,0,0,0,1}", default=IDENTITY)
    relation: Mapped[str] = mapped_column(server_default="in", default="in")
    confidence: Mapped[float | None]
    since: Mapped[datetime] = mapped_column(server_default=text("statement_timestamp()"))

    entity: Mapped[Entity] = relationship(
        foreign_keys="Placement.entity_id", back_populates="placement"
    )
    holder: Mapped[Entity | None] = relationship(foreign_keys=holder_id)


@event.listens_for(Placement.holder_id, "set")
@event.listens_for(Placement.holder, "set")
def _state_holder(placement: Placement, value: object, former: object, _initiator: object) -> None:
    """A holder that somebody sets is stated: the confidence was that of the derived one."""
    if value != former and inspect(placement).persistent:
        placement.confidence = None


class WorldPlacement(Base):
    """Where an entity is in the map's frame; kept by triggers.

    `box` is the diagonal of the 3D box (lowest to highest corner), `footprint` what the entity
    covers on the ground, None without geometry.
    """

    __tablename__ = "world"

    entity_id: Mapped[int] = mapped_column(
        ForeignKey(Placement.entity_id, ondelete="CASCADE"), primary_key=True
    )
    map_id: Mapped[int]
    storey_id: Mapped[int | None] = mapped_column(BigInteger)
    pose: Mapped[Pose]
    box: Mapped[Any] = mapped_column(Geometry("LINESTRINGZ", dimension=3, spatial_index=False))
    footprint: Mapped[Any | None] = mapped_column(Geometry("MULTIPOLYGON", spatial_index=False))
