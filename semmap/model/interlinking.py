"""Data sets, and which of their records describe the same resource."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, ForeignKey, Identity, Index, text
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.orm import Mapped, mapped_column, relationship

from semmap.model.base import Base

__all__ = ["DataRecord", "DataSet", "LinkSet", "RecordLink"]

NOW = text("clock_timestamp()")


class DataSet(Base):
    """The records of a file or map, as they were when they were interlinked."""

    __tablename__ = "data_set"

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    name: Mapped[str]
    digest: Mapped[str] = mapped_column(unique=True)
    at: Mapped[datetime] = mapped_column(server_default=NOW)

    records: Mapped[list[DataRecord]] = relationship(order_by="DataRecord.key", viewonly=True)


class DataRecord(Base):
    """A record; `properties` has a list of values for each property."""

    __tablename__ = "data_record"

    data_set_id: Mapped[int] = mapped_column(
        ForeignKey(DataSet.id, ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(primary_key=True)
    properties: Mapped[dict[str, list[str]]] = mapped_column(JSONB)


class LinkSet(Base):
    """The links between two data sets that one run found."""

    __tablename__ = "link_set"
    __table_args__ = (Index("link_set_left", "left_id"), Index("link_set_right", "right_id"))

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    left_id: Mapped[int] = mapped_column(ForeignKey(DataSet.id))
    right_id: Mapped[int] = mapped_column(ForeignKey(DataSet.id))
    pattern: Mapped[str]
    correspondences: Mapped[list[dict[str, Any]]] = mapped_column(JSONB)
    labels: Mapped[int]
    by: Mapped[str] = mapped_column(server_default=text("current_user"))
    at: Mapped[datetime] = mapped_column(server_default=NOW)

    left: Mapped[DataSet] = relationship(foreign_keys=left_id)
    right: Mapped[DataSet] = relationship(foreign_keys=right_id)
    links: Mapped[list[RecordLink]] = relationship(viewonly=True)


class RecordLink(Base):
    """Two records that describe the same resource; `resource` joins more than two of them."""

    __tablename__ = "record_link"

    link_set_id: Mapped[int] = mapped_column(
        ForeignKey(LinkSet.id, ondelete="CASCADE"), primary_key=True
    )
    left_key: Mapped[str] = mapped_column(primary_key=True)
    right_key: Mapped[str] = mapped_column(primary_key=True)
    confidence: Mapped[float]
    resource: Mapped[int]
