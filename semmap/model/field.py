"""Fields that were kept: a value a voxel, version by version, in cubes of voxels."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Identity, Index, Integer, UniqueConstraint, text
from sqlalchemy.dialects.postgresql import ARRAY, DOUBLE_PRECISION
from sqlalchemy.orm import Mapped, mapped_column

from semmap.model.base import Base
from semmap.model.entity import StoredMap

__all__ = ["Field", "FieldBlock", "FieldVersion"]


class Field(Base):
    """A field by name: what its values say, of whom, and on which voxels (metres).

    `edge` is that of its cubes in voxels, `version` the newest.
    """

    __tablename__ = "field"
    __table_args__ = (UniqueConstraint("map_id", "name", name="field_map_id_name_key"),)

    id: Mapped[int] = mapped_column(Integer, Identity(), primary_key=True)
    map_id: Mapped[int] = mapped_column(ForeignKey(StoredMap.id, ondelete="CASCADE"))
    name: Mapped[str]
    property: Mapped[str]
    about: Mapped[str | None]
    value_type: Mapped[str]
    voxel_size: Mapped[float]
    edge: Mapped[int]
    version: Mapped[int] = mapped_column(server_default="0", default=0)


class FieldVersion(Base):
    """A version of a field: when it was saved, and its data outside of cubes.

    `placement` are the upper three rows of its frame's pose in the map's, one after the other.
    """

    __tablename__ = "field_version"

    field_id: Mapped[int] = mapped_column(
        ForeignKey(Field.id, ondelete="CASCADE"), primary_key=True
    )
    version: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[datetime] = mapped_column(server_default=text("statement_timestamp()"))
    background: Mapped[float]
    placement: Mapped[list[float]] = mapped_column(ARRAY(DOUBLE_PRECISION()))
    legend: Mapped[dict[str, Any] | None]
    state: Mapped[dict[str, Any] | None]


class FieldBlock(Base):
    """A cube of voxels as bytes, and the versions that have it: from `since` to before `until`."""

    __tablename__ = "field_block"
    __table_args__ = (
        Index(
            "field_block_now",
            *("field_id", "x", "y", "z"),
            unique=True,
            postgresql_where=text("until IS NULL"),
        ),
    )

    field_id: Mapped[int] = mapped_column(
        ForeignKey(Field.id, ondelete="CASCADE"), primary_key=True
    )
    x: Mapped[int] = mapped_column(primary_key=True)
    y: Mapped[int] = mapped_column(primary_key=True)
    z: Mapped[int] = mapped_column(primary_key=True)
    since: Mapped[int] = mapped_column(primary_key=True)
    until: Mapped[int | None]
    digest: Mapped[bytes]
    bytes: Mapped[bytes]
