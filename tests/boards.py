"""Furniture of boards."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import trimesh

Board = Sequence[Sequence[float]]
"""The lowest and the highest corner, metres."""


def of_boards(boards: Iterable[Board]) -> trimesh.Trimesh:
    """The mesh of some boards, each of which is closed."""
    made = trimesh.util.concatenate([trimesh.creation.box(bounds=board) for board in boards])
    assert isinstance(made, trimesh.Trimesh)
    return made
