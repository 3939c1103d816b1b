"""The T-Box: semantic types and subsumption (Deeken et al., section 3.3, A2)."""

from __future__ import annotations

from typing import Any

from sqlalchemy import ForeignKey, text
from sqlalchemy.orm import Mapped, mapped_column, relationship

from semmap.model.base import Base


class SemanticType(Base):
    """A concept, named in lower snake case (``dining_table``)."""

    __tablename__ = "semantic_type"

    name: Mapped[str] = mapped_column(primary_key=True)
    label: Mapped[str | None]
    iri: Mapped[str | None] = mapped_column(unique=True)
    comment: Mapped[str | None]
    origin: Mapped[str] = mapped_column(server_default="import")
    typical_size: Mapped[list[float] | None]
    found_in: Mapped[list[str]] = mapped_column(server_default=text("'{}'"))
    keeps: Mapped[float | None]
    functions: Mapped[list[str]] = mapped_column(server_default=text("'{}'"))
    properties: Mapped[dict[str, Any]] = mapped_column(server_default=text("'{}'"))

    parents: Mapped[list[SemanticType]] = relationship(
        secondary="semmap.type_parent",
        primaryjoin="SemanticType.name == TypeParent.type",
        secondaryjoin="SemanticType.name == TypeParent.parent",
        backref="children",
    )


class TypeParent(Base):
    """A type and one that directly subsumes it."""

    __tablename__ = "type_parent"

    type: Mapped[str] = mapped_column(
        ForeignKey(SemanticType.name, onupdate="CASCADE", ondelete="CASCADE"), primary_key=True
    )
    parent: Mapped[str] = mapped_column(
        ForeignKey(SemanticType.name, onupdate="CASCADE", ondelete="CASCADE"), primary_key=True
    )
