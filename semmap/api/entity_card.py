"""An entity in a notebook: its parts in a table, and where it is in a small plan."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from semmap.api.map import Map


class EntityCard:
    """The part of `MapEntity` that shows it in a notebook."""

    if TYPE_CHECKING:
        map: Map
        id: int
        name: str

    def _repr_html_(self) -> str:
        """A card: what it is, where it is, and a plan of its room with it."""
        from semmap.api.map_pictures import room_svg
        from semmap.query.entity_query import describe_id

        known = describe_id(self.map.connection, self.id)
        rows = {
            "type": known["type"],
            "label": known["label"],
            "holder": known["holder"] and f"{known['relation']} {known['holder']}",
            "storey": known["storey"],
            "pose": known["pose"] and ", ".join(f"{v:.3f}" for v in known["pose"][:3]) + " m",
            "joins": "joins" in known and "{place_a} - {place_b}, {state}".format(**known["joins"]),
            "holds": ", ".join(known["holds"][:8]) + (", ..." if len(known["holds"]) > 8 else ""),
            **known["properties"],
        }
        table = "".join(
            f'<tr><th style="text-align:left">{html.escape(str(key))}</th>'
            f'<td style="text-align:left">{html.escape(str(value))}</td></tr>'
            for key, value in rows.items()
            if value not in (None, "", False)
        )
        return (
            '<div style="display:flex;gap:1em;align-items:flex-start"><div>'
            f"<b>{html.escape(known['name'])}</b> ({html.escape(known['kind'])})"
            f"<table>{table}</table></div>{room_svg(self.map, self.id)}</div>"
        )
