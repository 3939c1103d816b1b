"""What the evaluation of one query shares: the catalogue, codes of names, and the time spent."""

from __future__ import annotations

import time

from semmap.fields.queries.statements import Catalogue, StatementRelation
from semmap.fields.queries.table import LimitError, NameCodes
from semmap.language.schema import Property
from semmap.limits import QUERY_SECONDS


class Context:
    """The context of one evaluation: voxels of `voxel_size` metres, and `names` by code."""

    def __init__(self, catalogue: Catalogue) -> None:
        self.voxel_size = catalogue.voxel_size
        self.names = NameCodes()
        self._catalogue = catalogue
        self._relations: dict[Property, StatementRelation] = {}
        self._began = time.monotonic()

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation of a property, the same one for the whole query."""
        if property not in self._relations:
            self._relations[property] = self._catalogue.relation(property)
        return self._relations[property]

    def check_time(self) -> None:
        """Raise LimitError if the query has taken too long."""
        if QUERY_SECONDS.exceeded_by(time.monotonic() - self._began):
            raise LimitError(
                f"this takes longer than {QUERY_SECONDS.value:g} s: add narrower patterns, or set "
                f"{QUERY_SECONDS.variable}"
            )
