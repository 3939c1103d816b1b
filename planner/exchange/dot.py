"""The topology as Graphviz DOT: places as nodes, connectors as edges, storeys as clusters."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from planner.topology import OUTSIDE, Place, PlaceConnector, Topology

STATES = {"open": "#3b6ea5", "closed": "#b07a1f", "locked": "#b3261e"}
"""Colours of connectors by state, as in floor plans."""


def dot(topology: Topology, *, storey: str | None = None, name: str = "topology") -> str:
    """The topology as DOT text, or one storey with the places to which its connectors lead.

    One-way connectors have an arrow. Connectors that are not open have a colour and their state.
    Dashed lines join the cabins of an elevator. Raises ExchangeError for an unknown storey.
    """
    places = topology.places_on(storey)
    inside = {p.name for p in places}
    connectors = [c for c in topology.connectors.values() if inside & set(c.places)]
    beyond = {n for c in connectors for n in c.places} - inside
    places += [topology.places[n] for n in sorted(beyond)]
    lines = [
        f"graph {_quoted(name)} {{",
        '  graph [fontname="sans-serif", compound=true];',
        '  node [shape=box, style="rounded,filled", fillcolor="#f4f1e8", fontname="sans-serif"];',
        '  edge [fontname="sans-serif", fontsize=10];',
    ]
    storeys = dict.fromkeys(p.storey for p in places if p.storey is not None)
    for number, one in enumerate(storeys):
        lines += [f"  subgraph cluster_{number} {{", f"    label={_quoted(one)};"]
        lines += [f"    {_node(p)}" for p in places if p.storey == one]
        lines.append("  }")
    lines += [f"  {_node(p)}" for p in places if p.storey is None]
    lines += [f"  {_edge(c)}" for c in connectors]
    lines += [f"  {edge}" for edge in _rides(topology, {p.name for p in places})]
    return "\n".join([*lines, "}", ""])


def _quoted(text: str) -> str:
    """A quoted ID of DOT: backslashes and line ends keep their meaning."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + escaped.replace("\r", "").replace("\n", "\\n") + '"'


def _attributes(**values: str | None) -> str:
    return "[" + ", ".join(f"{k}={_quoted(v)}" for k, v in values.items() if v is not None) + "]"


def _node(place: Place) -> str:
    kind = place.label or (place.type if place.type != "room" else None)
    label = place.name if kind is None or kind == place.name else f"{place.name}\n{kind}"
    shape = "box3d" if place.elevator else "plaintext" if place.name == OUTSIDE else None
    return f"{_quoted(place.name)} {_attributes(label=label, shape=shape)};"


def _edge(connector: PlaceConnector) -> str:
    a, b = connector.places
    label = connector.name
    if connector.state != "open":
        label += f"\n{connector.state}"
    way = {"both": None, "forward": "forward", "backward": "back"}[connector.direction]
    attributes = _attributes(label=label, color=STATES[connector.state], dir=way)
    return f"{_quoted(a)} -- {_quoted(b)} {attributes};"


def _rides(topology: Topology, drawn: set[str]) -> Iterator[str]:
    def height(place: str) -> float:
        poses = [c.poses[side] for c, side in topology.connectors_of(place)]
        return min((pose.z for pose in poses), default=0.0)

    for elevator, cabins in topology.cabins().items():
        ordered = sorted((c for c in cabins if c in drawn), key=height)
        for a, b in pairwise(ordered):
            attributes = _attributes(label=elevator, style="dashed")
            yield f"{_quoted(a)} -- {_quoted(b)} {attributes};"
