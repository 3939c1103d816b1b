"""Slices through a grid of sets of entities, with a legend and the events beside them.

After Figure 1 of "VDB-based Spatially Grounded Semantics for Interactive Robots".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from semmap.draw.palette import INK, PAPER
from semmap.draw.sheet import draw_title

__all__ = ["VoxelSet", "VoxelSlice", "draw_slices", "set_colour", "slices_picture"]

_FAINT = "#6b6f76"
_ROWS = 31  # lines of text that fit beside the slices
_SETS = 13


@dataclass(frozen=True, eq=False)
class VoxelSlice:
    """The sets of entities on a plane.

    Attributes
    ----------
    numbers : (rows, columns) int32
        The number of a set; 0 for no set. Row 0 is the lowest.
    extent : (left, right, bottom, top), metres
    title : str
        The plane.
    axes : (str, str)
        The names of the directions of columns and rows.
    cut : ("v" or "h", float), optional
        Where the plane of another slice cuts this one: at a column or row coordinate, metres.
    """

    numbers: NDArray[np.int32]
    extent: tuple[float, float, float, float]
    title: str
    axes: tuple[str, str]
    cut: tuple[str, float] | None = None


@dataclass(frozen=True)
class VoxelSet:
    """A set of entities: the names of its members, and the number of its voxels."""

    members: tuple[str, ...]
    voxels: int


def set_colour(members: Sequence[str], colours: Mapping[str, str]) -> tuple[float, float, float]:
    """Return the colour of a set: a mixture of its members' colours, darker with more members."""
    parts = np.array([to_rgb(colours.get(name, _FAINT)) for name in members])
    shares = 0.5 ** np.arange(len(members))
    r, g, b = (shares @ parts / shares.sum() * 0.93 ** (len(members) - 1)).tolist()
    return r, g, b


def draw_slices(
    figure: Figure,
    slices: Sequence[VoxelSlice],
    sets: Mapping[int, VoxelSet],
    colours: Mapping[str, str],
    *,
    title: str = "",
    events: Sequence[str] = (),
    relations: Sequence[str] = (),
) -> None:
    """Draw slices one above the other into a figure, and a legend of the sets beside them.

    Parameters
    ----------
    figure : Figure
    slices : sequence of VoxelSlice
    sets : mapping of VoxelSet, by number
    colours : mapping of colours, by name of entity
        By default grey.
    title : str
    events : sequence of str
        The events of this step, one per line.
    relations : sequence of str
        The relations that hold, one per line.
    """
    figure.clear()
    figure.set_facecolor(PAPER)
    grid = figure.add_gridspec(
        len(slices),
        2,
        width_ratios=(2.35, 1),
        left=0.05,
        right=0.98,
        bottom=0.065,
        top=0.9,
        wspace=0.05,
        hspace=0.24,
        height_ratios=[abs(s.extent[3] - s.extent[2]) for s in slices],
    )
    table = np.ones((max([*sets, 0]) + 1, 4))
    table[0] = (0, 0, 0, 0)
    for number, each in sets.items():
        table[number, :3] = set_colour(each.members, colours)
    for i, each_slice in enumerate(slices):
        _slice(figure.add_subplot(grid[i, 0]), each_slice, table)
    draw_title(figure, title, 0.955, 14, left=0.05)
    _beside(figure.add_subplot(grid[:, 1]), sets, table, events, relations)


def slices_picture(
    path: Path | str,
    slices: Sequence[VoxelSlice],
    sets: Mapping[int, VoxelSet],
    colours: Mapping[str, str],
    *,
    title: str = "",
    events: Sequence[str] = (),
    relations: Sequence[str] = (),
) -> Path:
    """Save slices as PNG; return the path of the picture. Parameters as for `draw_slices`."""
    figure = Figure(figsize=(13, 9), dpi=110)
    FigureCanvasAgg(figure)
    draw_slices(figure, slices, sets, colours, title=title, events=events, relations=relations)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, facecolor=PAPER)
    return path


def _slice(axes: Axes, slice_: VoxelSlice, table: NDArray[np.float64]) -> None:
    axes.set_facecolor("white")
    axes.imshow(
        table[slice_.numbers], origin="lower", extent=slice_.extent, interpolation="nearest"
    )
    _borders(axes, slice_)
    if slice_.cut is not None:
        way, at = slice_.cut
        line = axes.axvline if way == "v" else axes.axhline
        line(at, color=INK, lw=0.8, ls=(0, (6, 4)), alpha=0.55)
    axes.set_title(slice_.title, fontsize=10, color=_FAINT, loc="left", pad=5)
    axes.set_xlabel(f"{slice_.axes[0]}, m", fontsize=9, color=_FAINT, labelpad=2)
    axes.set_ylabel(f"{slice_.axes[1]}, m", fontsize=9, color=_FAINT)
    axes.tick_params(labelsize=8, colors=_FAINT)
    for spine in axes.spines.values():
        spine.set_color("#c9c5ba")


def _borders(axes: Axes, slice_: VoxelSlice) -> None:
    """Draw thin lines between different sets."""
    numbers = slice_.numbers
    left, right, bottom, top = slice_.extent
    x = np.linspace(left, right, numbers.shape[1] + 1)
    y = np.linspace(bottom, top, numbers.shape[0] + 1)
    rows, columns = np.nonzero(numbers[:, 1:] != numbers[:, :-1])
    axes.vlines(x[columns + 1], y[rows], y[rows + 1], color=INK, lw=0.5, alpha=0.55)
    rows, columns = np.nonzero(numbers[1:] != numbers[:-1])
    axes.hlines(y[rows + 1], x[columns], x[columns + 1], color=INK, lw=0.5, alpha=0.55)


def _beside(
    axes: Axes,
    sets: Mapping[int, VoxelSet],
    table: NDArray[np.float64],
    events: Sequence[str],
    relations: Sequence[str],
) -> None:
    """Write the sets, those with the most members first, then events, then relations."""
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(_ROWS, -0.6)
    row = _heading(axes, 0, f"{len(sets)} sets")
    ordered = sorted(sets.items(), key=lambda item: (-len(item[1].members), -item[1].voxels))
    for number, each in ordered[:_SETS]:
        axes.add_patch(
            Rectangle((0, row - 0.34), 0.05, 0.68, fc=table[number], ec=INK, lw=0.6, clip_on=False)
        )
        axes.text(0.075, row, " + ".join(each.members), fontsize=8.5, color=INK, va="center")
        axes.text(1, row, f"{each.voxels:,}", fontsize=8, color=_FAINT, va="center", ha="right")
        row += 1
    if len(ordered) > _SETS:
        axes.text(
            0.075, row, f"and {len(ordered) - _SETS} more", fontsize=8.5, color=_FAINT, va="center"
        )
        row += 1
    for heading, lines, colour, room in (
        ("this step", events, "#b3261e", 8),
        ("holds", relations, INK, 99),
    ):
        row = _heading(axes, row + 0.5, heading)
        fit = max(1, min(room, int(_ROWS - row)))
        shown = lines if len(lines) <= fit else lines[: fit - 1]
        rest = [f"and {len(lines) - len(shown)} more"] if len(shown) < len(lines) else []
        for line in [*shown, *rest] or ["nothing"]:
            axes.text(0, row, line, fontsize=8.5, color=colour if lines else _FAINT, va="center")
            row += 0.9


def _heading(axes: Axes, row: float, text: str) -> float:
    axes.text(0, row, text, fontsize=10, weight="bold", color=INK, va="center")
    return row + 1.05
