"""The fields of a map, as its property."""

from __future__ import annotations

from functools import cached_property

from semmap.api.map_questions import MapQuestions
from semmap.api.spatial_fields import SpatialFields
from semmap.fields.service.client import ServiceAddress


class MapSpace(MapQuestions):
    """The part of `Map` with what space contains."""

    @cached_property
    def fields(self) -> SpatialFields:
        """The fields of the map, with voxels of 5 cm."""
        return SpatialFields(ServiceAddress(self.database.address, self.name), lambda: self)
