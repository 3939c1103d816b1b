"""Changes of the edges of a routing graph for one query."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass
class Penalties:
    """Changes of the edges of a routing graph for one query, by number of the edge.

    `seconds` are added to the cost, which decides on the route and is no duration; `blocked` says
    why an edge must not be used; `detours` are seconds and metres of longer travel.
    """

    seconds: dict[int, float] = field(default_factory=dict)
    blocked: dict[int, str] = field(default_factory=dict)
    detours: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, edges: Iterable[int], seconds: float, reason: str) -> None:
        """Make edges cost more; infinite seconds block them for this reason."""
        for edge in edges:
            if math.isinf(seconds):
                self.blocked.setdefault(edge, reason)
            else:
                self.seconds[edge] = self.seconds.get(edge, 0.0) + seconds
