"""Costmaps as text for the terminal."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from rich.table import Table
from rich.text import Text

from navgrid.cost_source import CostSource
from navgrid.costmap import Costmap
from navgrid.nav2 import Files
from semmap import cli
from semmap.draw.palette import PART_COLOURS


def show_explanation(costmaps: Iterable[Costmap], x: float, y: float, json_: bool) -> None:
    """Print the causes of the cost at a point, per storey; ValueError if it is on no grid."""
    rows: list[dict[str, Any]] = []
    for costmap in costmaps:
        try:
            row, column = costmap.grid.cell(x, y)
        except ValueError:
            continue
        rows.append(
            {
                "storey": costmap.scene.storey,
                "cost": int(costmap.master[row, column]),
                "because": [asdict(source) for source in costmap.explain(x, y)],
            }
        )
    if not rows:
        raise ValueError(f"({x}, {y}) is on none of the grids; give a point within the map")
    if json_:
        print(json.dumps(rows))
        return
    for found in rows:
        cli.out.print(f"{found['storey']}: cost {found['cost']}")
        sources = [CostSource(**source) for source in found["because"]]
        if sources:
            cli.out.print(_source_table(sources))


def _source_table(sources: Sequence[CostSource]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("cost", "part", "layer", "metres away", "entities"):
        table.add_column(name)
    for source in sources:
        entities = ", ".join(
            f"{name} (assumed size)" if name in source.assumed else name for name in source.entities
        )
        table.add_row(
            str(source.cost),
            source.part,
            source.layer,
            f"{source.distance:.2f}",
            entities if source.field is None else f"{entities} (field {source.field})",
        )
    return table


def show_files(written: Iterable[Files], costmaps: Iterable[Costmap]) -> None:
    """Print what was written, per storey, and what costmaps say of objects and fields."""
    for files in written:
        cli.out.print(
            f"{files['storey']}: {files['folder']}: {len(files['maps'])} maps of "
            f"{files['width']} x {files['height']} cells of {files['resolution']:g} m, "
            f"frame {files['frame']}"
        )
        for number, part in enumerate(files["parts"]):
            low, high = (round(end, 3) + 0.0 for end in part["interval"])
            radii = part["inscribed_radius"], part["circumscribed_radius"]
            cli.out.print(
                Text.assemble(
                    "  ",
                    (part["name"], PART_COLOURS[number % len(PART_COLOURS)]),
                    f": {low:.2f} to {high:.2f} m, {radii[0]:.2f} to {radii[1]:.2f} m "
                    "around the axis",
                )
            )
        cli.out.print(
            f"  the shape fits at some headings, not all, in {files['some_headings']} cells"
        )
    for costmap in costmaps:
        for note in costmap.notes:
            cli.out.print(f"{costmap.scene.storey}: {note}", style="yellow")
