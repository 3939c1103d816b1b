"""What follows from the facts of a map, and the shapes that bind its updates."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import (
    ARRAY,
    BigInteger,
    Boolean,
    Column,
    ForeignKey,
    Index,
    Integer,
    Table,
    Text,
    func,
    text,
)
from sqlalchemy.orm import Mapped, mapped_column

from semmap.model.base import Base
from semmap.model.entity import StoredMap

__all__ = ["BindingShapes", "Reasoning", "inference"]


class Reasoning(Base):
    """The state of the inferences of a map."""

    __tablename__ = "reasoning"

    map_id: Mapped[int] = mapped_column(
        ForeignKey(StoredMap.id, ondelete="CASCADE"), primary_key=True
    )
    axioms: Mapped[str]
    cursor: Mapped[str]
    at: Mapped[datetime] = mapped_column(server_default=func.clock_timestamp())
    properties: Mapped[list[str]] = mapped_column(ARRAY(Text), server_default="{}")
    classes: Mapped[list[str]] = mapped_column(ARRAY(Text), server_default="{}")
    inferences: Mapped[int] = mapped_column(BigInteger, server_default="0")
    contradictions: Mapped[int] = mapped_column(BigInteger, server_default="0")


inference = Table(
    "inference",
    Base.metadata,
    Column("map_id", Integer, ForeignKey(Reasoning.map_id, ondelete="CASCADE"), nullable=False),
    Column("subject_id", BigInteger),
    Column("subject", Text),
    Column("predicate", Text, nullable=False),
    Column("object_id", BigInteger),
    Column("object", Text),
    Column("tag", Text),
    Column("told", Boolean, nullable=False),
    Index(
        "inference_subject_id",
        "subject_id",
        "predicate",
        postgresql_where=text("subject_id IS NOT NULL"),
    ),
    Index(
        "inference_object_id",
        "object_id",
        "predicate",
        postgresql_where=text("object_id IS NOT NULL"),
    ),
    Index(
        "inference_subject",
        "map_id",
        "subject",
        "predicate",
        postgresql_where=text("subject IS NOT NULL"),
    ),
    Index(
        "inference_object",
        "map_id",
        text("md5(object)"),
        "predicate",
        postgresql_where=text("object IS NOT NULL"),
    ),
    Index(
        "inference_predicate",
        "map_id",
        "predicate",
        "object",
        postgresql_where=text("NOT told AND tag = 'I'"),
    ),
)
"""The facts that rules are about: copies of what is told, and inferences."""


class BindingShapes(Base):
    """SHACL shapes in Turtle, which updates of a map must not break."""

    __tablename__ = "binding_shapes"

    map_id: Mapped[int] = mapped_column(
        ForeignKey(StoredMap.id, ondelete="CASCADE"), primary_key=True
    )
    name: Mapped[str] = mapped_column(primary_key=True)
    turtle: Mapped[str]
    at: Mapped[datetime] = mapped_column(server_default=func.clock_timestamp())
