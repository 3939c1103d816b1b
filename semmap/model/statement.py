"""Statements that no other table has a column for: RDF triples in named graphs."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, ForeignKey, Identity, Index, func, text
from sqlalchemy.orm import Mapped, mapped_column

from semmap.model.base import Base
from semmap.model.entity import Entity, StoredMap

__all__ = ["Statement"]


class Statement(Base):
    """A triple: subject and object are entities of the map, or terms.

    `tag` states what the text `object` is: ``I`` for an IRI, ``@`` and a language, or the datatype.
    The empty `graph` is the default graph. A statement with `until` ends then.
    """

    __tablename__ = "statement"
    __table_args__ = (
        Index(
            "statement_once",
            "map_id",
            "predicate",
            "graph",
            text("coalesce(subject_id, 0)"),
            text("coalesce(subject, '')"),
            text("coalesce(object_id, 0)"),
            text("md5(coalesce(object, ''))"),
            text("coalesce(tag, '')"),
            unique=True,
        ),
        Index(
            "statement_subject_id",
            "subject_id",
            "predicate",
            postgresql_where=text("subject_id IS NOT NULL"),
        ),
        Index(
            "statement_object_id",
            "object_id",
            "predicate",
            postgresql_where=text("object_id IS NOT NULL"),
        ),
        Index(
            "statement_subject",
            "map_id",
            "subject",
            "predicate",
            postgresql_where=text("subject IS NOT NULL"),
        ),
        Index(
            "statement_object",
            "map_id",
            "predicate",
            postgresql_where=text("object IS NOT NULL"),
        ),
        Index("statement_until", "until", postgresql_where=text("until IS NOT NULL")),
    )

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    map_id: Mapped[int] = mapped_column(ForeignKey(StoredMap.id, ondelete="CASCADE"))
    graph: Mapped[str] = mapped_column(server_default="")
    subject_id: Mapped[int | None] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    subject: Mapped[str | None]
    predicate: Mapped[str]
    object_id: Mapped[int | None] = mapped_column(ForeignKey(Entity.id, ondelete="CASCADE"))
    object: Mapped[str | None]
    tag: Mapped[str | None]
    since: Mapped[datetime] = mapped_column(server_default=func.clock_timestamp())
    until: Mapped[datetime | None]
