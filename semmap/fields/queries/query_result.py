"""The map that a query's STORE makes."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np

from semmap.fields.queries import Stored
from semmap.fields.maps.representation_map import Lattice, RepresentationMap, empty
from semmap.fields.queries.statements import Numbers, Things

__all__ = ["stored_map"]


def stored_map(answer: Stored, time: datetime | None = None) -> RepresentationMap:
    """A map of the class that the query named: of its voxels, with what they were bound to.

    Voxels of several things have one of them, the last by name.
    """
    lattice = Lattice(answer.voxel_size)
    voxels, said = answer.voxels, answer.statements.object
    if isinstance(said, Numbers):
        grid = empty("float32", lattice)
        grid.set(voxels, said.values.astype(np.float32))
        return RepresentationMap(answer.property, grid, time=time)
    if answer.about is not None or not isinstance(said, Things) or not len(voxels):
        seen = empty("bool", lattice)
        seen.set(voxels, np.ones(len(voxels), np.bool_))
        return RepresentationMap(answer.property, seen, about=answer.about, time=time)
    rank = np.argsort(np.argsort(np.array(said.names)))
    order = np.argsort(rank[said.codes], kind="stable")
    things: Any = empty("int32", lattice)
    things.set(np.ascontiguousarray(voxels[order]), said.codes[order] + 1)
    legend = {code + 1: name for code, name in enumerate(said.names)}
    return RepresentationMap(answer.property, things, legend=legend, time=time)
