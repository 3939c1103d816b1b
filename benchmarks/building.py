"""A building as a graph: floors of a lattice of rooms, doors in most walls, and some shafts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Building", "building"]

PITCH = 5.0  # metres from a room's middle to the next
STOREY = 3.2  # metres
DOORS = 0.97  # of the walls
SLOWEST = 3.0  # what a door may add, in seconds at a metre a second


@dataclass(frozen=True, eq=False)
class Building:
    """Rooms are nodes; edges join two rooms and are passed both ways.

    Attributes
    ----------
    places : (n, 3) where one stands in each room, metres
    edges : (E, 2) int64
    weights : (E,) float64, seconds
    """

    places: NDArray[np.float64]
    edges: NDArray[np.int64]
    weights: NDArray[np.float64]

    @property
    def directed(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Tails, heads and weights of each edge there, and then of each back."""
        there, back = self.edges.T
        return (
            np.concatenate([there, back]),
            np.concatenate([back, there]),
            np.concatenate([self.weights, self.weights]),
        )


def building(
    floors: int = 20, rooms_x: int = 40, rooms_y: int = 32, shafts: int = 16, seed: int = 7
) -> Building:
    """A building of that size; the same for the same seed."""
    random = np.random.default_rng(seed)
    rooms = np.arange(floors * rooms_x * rooms_y).reshape(floors, rooms_x, rooms_y)
    floor, x, y = np.indices(rooms.shape)
    aside = random.uniform(-1, 1, (2, *rooms.shape))
    places = np.stack([PITCH * x + aside[0], PITCH * y + aside[1], STOREY * floor], axis=-1)
    walls = np.concatenate(
        [
            np.stack([rooms[:, :-1].ravel(), rooms[:, 1:].ravel()], axis=1),
            np.stack([rooms[:, :, :-1].ravel(), rooms[:, :, 1:].ravel()], axis=1),
        ]
    )
    doors = walls[random.random(len(walls)) < DOORS]
    at = random.choice(rooms_x * rooms_y, shafts, replace=False)
    columns = rooms.reshape(floors, -1)[:, at]
    flights = np.stack([columns[:-1].ravel(), columns[1:].ravel()], axis=1)
    edges = np.concatenate([doors, flights])
    flat = places.reshape(-1, 3)
    metres = np.linalg.norm(flat[edges[:, 0]] - flat[edges[:, 1]], axis=1)
    return Building(flat, edges, metres + random.uniform(0, SLOWEST, len(edges)))
