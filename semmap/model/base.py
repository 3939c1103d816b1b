"""What all classes of the map share: the schema, the names of constraints, the pose column."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from sqlalchemy import BigInteger, DateTime, Dialect, ForeignKey, Identity, MetaData, Text
from sqlalchemy.dialects.postgresql import ARRAY, DOUBLE_PRECISION, JSONB
from sqlalchemy.orm import DeclarativeBase, mapped_column
from sqlalchemy.types import TypeDecorator

from semmap.geometry.pose import Pose


class PoseColumn(TypeDecorator[Pose]):
    """A `Pose` kept as ``double precision[]``: (x, y, z, qx, qy, qz, qw)."""

    impl = ARRAY(DOUBLE_PRECISION())
    cache_ok = True

    def process_bind_param(self, value: Pose | None, dialect: Dialect) -> list[float] | None:
        """A pose on its way in."""
        return None if value is None else value.row

    def process_result_value(self, value: Any, dialect: Dialect) -> Pose | None:
        """A pose on its way out."""
        return None if value is None else Pose(*value)


class Base(DeclarativeBase):
    """Declarative base; every table lies in the schema `semmap`."""

    metadata = MetaData(schema="semmap")
    type_annotation_map = {  # noqa: RUF012
        str: Text(),
        float: DOUBLE_PRECISION(),
        datetime: DateTime(timezone=True),
        dict[str, Any]: JSONB(),
        list[int]: ARRAY(BigInteger()),
        list[float]: ARRAY(DOUBLE_PRECISION()),
        list[str]: ARRAY(Text()),
        Pose: PoseColumn(),
    }


EntityKey = Annotated[
    int,
    mapped_column(BigInteger, ForeignKey("semmap.entity.id", ondelete="CASCADE"), primary_key=True),
]
"""The key of a table with a row for each of some entities."""

RowId = Annotated[int, mapped_column(BigInteger, Identity(), primary_key=True)]
"""A key that the database counts."""
