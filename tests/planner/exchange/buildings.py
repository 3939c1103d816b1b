"""Random buildings: storeys of rooms that doors join at random, and an elevator through them."""

from __future__ import annotations

import math
from dataclasses import replace

from hypothesis import strategies as st

from planner.topology import OUTSIDE, Place, PlaceConnector, Topology
from tests.planner.office import door, office

BEHAVIOURS = ("pass_door", "drive_through", "call_elevator")

NAMES = (
    "lab",
    'the "lab"',
    "a\\b",
    "Küche",
    "<b>",
    "two\nlines",
    "{x|y}",
    "",
    "n0",
    "-",
    "ja: nein",
)
"""What people call rooms."""


def figure_4(**changed: dict[str, object]) -> Topology:
    """The office with office4 on the upper storey, where Figure 4 has it."""
    drawn = office(**changed)
    upper = replace(drawn.places["office4"], storey="floor-3rd")
    return Topology({**drawn.places, "office4": upper}, drawn.connectors)


@st.composite
def buildings(draw: st.DrawFn) -> Topology:
    """Up to three storeys of up to five places each; every state and direction of connectors."""
    places: list[Place] = []
    connectors: list[PlaceConnector] = []
    numbers = st.floats(-20, 20).map(lambda v: round(v, 2))
    for level in range(draw(st.integers(1, 3))):
        odd = draw(st.sampled_from(NAMES))
        names = [f"{odd}{level}{n}" for n in range(draw(st.integers(2, 5)))]
        rooms = [Place(n, storey=f"level {level}") for n in names]
        places += rooms
        joined = draw(
            st.lists(
                st.tuples(st.sampled_from(names), st.sampled_from([*names, OUTSIDE])).filter(
                    lambda pair: pair[0] != pair[1]
                ),
                max_size=7,
            )
        )
        if draw(st.booleans()):
            places.append(Place(f"cabin{level}", storey=f"level {level}", elevator="lift"))
            joined.append((names[0], f"cabin{level}"))
        for number, (a, b) in enumerate(joined):
            connectors.append(
                door(
                    f"{odd}door{level}-{number}",
                    a,
                    b,
                    draw(numbers),
                    draw(numbers),
                    draw(st.floats(-math.pi, math.pi)),
                    4.0 * level,
                    type="elevator_door" if b.startswith("cabin") else "door",
                    behaviour=draw(st.sampled_from(BEHAVIOURS)),
                    state=draw(st.sampled_from(("open", "open", "closed", "locked"))),
                    direction=draw(st.sampled_from(("both", "both", "forward", "backward"))),
                )
            )
    return Topology.of(places, connectors)
