"""Geometric models (Deeken et al., section 3.3, A1): stored once, shared by all instances."""

from __future__ import annotations

from typing import Any

from geoalchemy2 import Geometry
from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from semmap.model.base import Base, EntityKey, RowId


class GeometricModel(Base):
    """A mesh, box, point cloud, polygon or CAD reference, in its own frame (metres).

    `hull` are the corners of the convex hull, from which the exact extents follow however the
    model is turned; `outline` is the footprint of the upright model where it is known.
    """

    __tablename__ = "model"

    id: Mapped[RowId]
    digest: Mapped[str] = mapped_column(unique=True)
    kind: Mapped[str]
    uri: Mapped[str | None]
    triangles: Mapped[int]
    closed: Mapped[bool | None]
    hull: Mapped[Any] = mapped_column(Geometry("MULTIPOINTZ", dimension=3, spatial_index=False))
    outline: Mapped[Any | None] = mapped_column(Geometry("MULTIPOLYGON", spatial_index=False))


class EntityModel(Base):
    """That an entity has a model, to be seen (`visual`) or to be bumped into (`collision`)."""

    __tablename__ = "entity_model"
    __table_args__ = (Index("entity_model_model", "model_id"),)

    entity_id: Mapped[EntityKey]
    model_id: Mapped[int] = mapped_column(ForeignKey(GeometricModel.id), primary_key=True)
    role: Mapped[str] = mapped_column(server_default="visual", default="visual", primary_key=True)
