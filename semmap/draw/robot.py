"""Pictures of a robot's parts, their heights and footprints (Deeken et al., Figures 6 and 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patches import Polygon as Patch
from matplotlib.ticker import MultipleLocator

from semmap.draw.labels import Style
from semmap.draw.palette import INK, PAPER, PART_COLOURS
from semmap.draw.scene3d import scene3d
from semmap.draw.sheet import save_sheet
from semmap.draw.view import ObjectView, StoreyView
from semmap.geometry.mesh import Mesh, join
from semmap.geometry.pose import Pose
from semmap.robot.parts import Part


def robot_views(
    parts: Sequence[Part], meshes: Mapping[str, Mesh], pose: Pose | None = None
) -> list[ObjectView]:
    """Return one object per part, at the robot's pose; meshes are by link, in the robot's frame."""
    found = []
    for part, colour in zip(parts, cycle(PART_COLOURS)):
        mesh = join([meshes[link] for link in part.links if link in meshes])
        shown = mesh if pose is None else mesh.moved(pose)
        found.append(ObjectView(part.name, ("robot",), shown, colour=colour))
    return found


def parts_picture(
    parts: Sequence[Part], meshes: Mapping[str, Mesh], path: Path | str, title: str = ""
) -> Path:
    """Draw the robot in 3D with a colour per part (Figure 6); return the path of the picture."""
    storey = StoreyView("robot", objects=robot_views(parts, meshes))
    return scene3d(
        [storey], path, title=title, boxes=False, azimuth=-50, elevation=18, width=560, cut=9
    )


def footprints_picture(parts: Sequence[Part], path: Path | str, title: str = "") -> Path:
    """Draw the heights and footprints of parts (Figure 7); return the path of the picture."""
    figure = Figure(figsize=(11, 6.2), dpi=150, facecolor=PAPER, layout="constrained")
    side, above = figure.subplots(1, 2, width_ratios=(1, 1.35))
    beside: Style = {"textcoords": "offset points", "va": "center", "fontsize": 9, "color": INK}
    for part, colour in zip(parts, cycle(PART_COLOURS)):
        low, high = part.interval
        x0, x1 = part.footprint[:, 0].min(), part.footprint[:, 0].max()
        side.add_patch(
            Patch([(x0, low), (x1, low), (x1, high), (x0, high)], fc=colour, ec=colour, alpha=0.45)
        )
        text = f"{part.name}\n{abs(low) if abs(low) < 5e-3 else low:.2f} to {high:.2f} m"
        side.annotate(text, (x1, (low + high) / 2), (6, 0), **beside)
        above.add_patch(Patch(part.footprint, fc=colour, ec=colour, alpha=0.35, lw=1.5))
        above.add_patch(Patch(part.footprint, fc="none", ec=colour, lw=1.8))
        radii = part.inscribed_radius, part.circumscribed_radius
        label = f"{part.name}: {radii[0]:.2f} to {radii[1]:.2f} m"
        ring = Circle((0, 0), radii[1], fc="none", ec=colour, lw=1.2, ls="--", label=label)
        above.add_patch(ring)
    above.plot([0], [0], marker="+", color=INK, ms=12)
    above.annotate("", (0.12, 0), (0, 0), arrowprops={"arrowstyle": "->", "color": INK})
    reach = max(p.circumscribed_radius for p in parts) * 1.12
    heights = -0.05, max(p.interval[1] for p in parts) * 1.06
    _frame(side, (-reach, reach + 0.35), heights, "z, metres", "intervals of height")
    inflated = "footprints, and the radius that inflates each layer"
    _frame(above, (-reach, reach), (-reach, reach), "y, metres", inflated)
    above.legend(loc="upper left", fontsize=8, frameon=True)
    figure.suptitle(title, x=0.02, ha="left", fontsize=13, weight="bold", color=INK)
    return save_sheet(figure, path)


def _frame(axes: Axes, x: tuple[float, float], y: tuple[float, float], up: str, title: str) -> None:
    axes.set(xlim=x, ylim=y, aspect="equal")
    axes.set_xlabel("x, metres", fontsize=9)
    axes.set_ylabel(up, fontsize=9)
    axes.set_title(title, fontsize=10, loc="left", color=INK)
    step = 0.2 if np.ptp(x) < 3 else 0.5
    axes.xaxis.set_major_locator(MultipleLocator(step))
    axes.yaxis.set_major_locator(MultipleLocator(step))
    axes.grid(alpha=0.25)
    axes.tick_params(labelsize=8)
