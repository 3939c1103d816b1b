"""Semantic annotations that people draw: rooms, doors, regions and properties as map features."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from semmap.ingest.annotation.areas import (
    add_elevator,
    add_object,
    add_region,
    add_room,
    add_storey,
    overlaps,
)
from semmap.ingest.annotation.connectors import add_connector
from semmap.ingest.annotation.draft_world import Draft, DraftWorld
from semmap.ingest.world import Kind, World

KINDS: dict[Kind, Callable[[DraftWorld, Draft], None]] = {
    "storey": add_storey,
    "elevator": add_elevator,
    "room": add_room,
    "connector": add_connector,
    "region": add_region,
    "object": add_object,
    "agent": add_object,
}
"""How each kind is added; a holder comes before what it holds."""


def read_annotation(path: Path, name: str | None = None) -> World:
    """Return the world that the features of a GeoJSON file or GeoPackage describe.

    Coordinates are metres in the map's frame; heights (`floor`, `ceiling`) are above the feature's
    storey, or above the map's origin where the file has no storey. Properties that every feature
    may have: `kind` (default: that of its layer, else that of its `type` in the T-Box), `name`,
    `type` (``DiningTable``, ``dining table`` or ``dining_table``), `label`, `storey` (needed where
    the file has several), `holder`, `heading` (radians, or `heading_deg`), `front`. Others become
    free properties.

    - room: polygon, `floor`, `ceiling`, `elevator` (the elevator whose cabin it is)
    - connector: the line of the opening, or a point with `width` and `heading`; `joins`
      (``"bath,hall"``, the first being where x comes from; by default the places on both sides
      of the line), `state`, `direction`, `behaviour`; `height` of the clear opening, `step` of its
      threshold, `permissions` of which one is needed (``"staff,cleaning"``). Stairs and ramps are
      lines along the way.
    - region: polygon or point; `blocked`, `home`
    - storey: `elevation`, `height`; elevator; object (polygon with `height`, or point); agent
    - without a geometry: an entry with nothing but its semantics

    Raises
    ------
    WorldError
        The file as a whole cannot be trusted. A feature that cannot be used is in `skipped`.
    """
    draft_world = DraftWorld(Path(path), name)
    for kind, add in KINDS.items():
        for draft in draft_world.drafts_of(kind):
            draft_world.attempt(draft.feature, add, draft_world, draft)
    draft_world.out.notes += overlaps(draft_world.rooms)
    return draft_world.out
