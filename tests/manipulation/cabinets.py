"""Cabinets at random as URDF: a body, and a door on a hinge or a drawer on a slide, with a handle.

The front of a cabinet looks to -x; its bottom is at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

Kind = Literal["door", "drawer"]
Form = Literal["bar", "knob"]


def box(size: Sequence[float], at: Sequence[float]) -> str:
    """A box as a visual and a collision of a link."""
    return _shape('<box size="{:.5f} {:.5f} {:.5f}"/>'.format(*size), at)


def rod(radius: float, length: float, at: Sequence[float], along: str) -> str:
    """A cylinder along x, y or z."""
    turn = {"x": (0, np.pi / 2, 0), "y": (np.pi / 2, 0, 0), "z": (0, 0, 0)}[along]
    return _shape(f'<cylinder radius="{radius:.5f}" length="{length:.5f}"/>', at, turn)


def _shape(shape: str, at: Sequence[float], turn: Sequence[float] = (0, 0, 0)) -> str:
    origin = '<origin xyz="{:.5f} {:.5f} {:.5f}" rpy="{:.7f} {:.7f} {:.7f}"/>'.format(*at, *turn)
    return "".join(
        f"<{role}>{origin}<geometry>{shape}</geometry></{role}>" for role in ("visual", "collision")
    )


@dataclass(frozen=True)
class Cabinet:
    """Outer sizes and thickness of its panels, metres; `hinge` is the side of a door's hinge, y.

    `travel` is the upper limit of its joint, radians or metres. The handle stands `off` the front,
    `length` and `radius` are of a bar or of a knob's cap. `apart`: it is a link of its own.
    """

    kind: Kind
    form: Form
    width: float
    height: float
    depth: float
    thick: float
    hinge: int
    travel: float
    off: float
    radius: float
    length: float
    apart: bool = False
    solids: bool = field(default=True, repr=False)

    @classmethod
    def random(cls, seed: int, kind: Kind | None = None, form: Form | None = None) -> Cabinet:
        """A cabinet of a seed."""
        draw = np.random.default_rng(seed)
        kinds: tuple[Kind, Kind] = ("door", "drawer")
        forms: tuple[Form, Form] = ("bar", "knob")
        chosen, shape = kinds[draw.integers(2)], forms[draw.integers(2)]
        chosen, shape = kind or chosen, form or shape
        is_door = chosen == "door"
        depth = draw.uniform(0.3, 0.5)
        return cls(
            chosen,
            shape,
            draw.uniform(0.25, 0.6),
            draw.uniform(0.3, 0.8) if is_door else draw.uniform(0.12, 0.3),
            depth,
            draw.uniform(0.015, 0.025),
            int(draw.choice([-1, 1])),
            draw.uniform(1.2, 1.9) if is_door else draw.uniform(0.6, 0.85) * depth,
            draw.uniform(0.035, 0.05),
            draw.uniform(0.005, 0.009) if shape == "bar" else draw.uniform(0.012, 0.018),
            draw.uniform(0.09, 0.18),
            bool(draw.integers(2)),
        )

    @property
    def handle_at(self) -> tuple[float, float, float]:
        """The middle of the handle in the frame of the part."""
        if self.kind == "drawer":
            return (-self.thick / 2 - self.off, 0.0, 0.0)
        return (-self.thick / 2 - self.off, -self.hinge * (self.width - 0.04), 0.0)

    @property
    def part_at(self) -> tuple[float, float, float]:
        """The origin of the part in the frame of the cabinet: of a door, on its hinge."""
        y = self.hinge * self.width / 2 if self.kind == "door" else 0.0
        return (-self.depth / 2 - self.thick / 2, y, self.height / 2)

    def write(self, path: Path) -> Path:
        """Write it as URDF."""
        part, handle = self._part(), self._handle()
        joint = {
            "door": f'revolute"><axis xyz="0 0 {-self.hinge}"/>',
            "drawer": 'prismatic"><axis xyz="-1 0 0"/>',
        }[self.kind]
        at = "{:.5f} {:.5f} {:.5f}".format(*self.part_at)
        grip = "" if self.apart else handle
        extra = (
            f'<link name="handle">{handle}</link><joint name="fixed" type="fixed">'
            f'<parent link="{self.kind}"/><child link="handle"/></joint>'
            if self.apart
            else ""
        )
        path.write_text(
            f'<robot name="cabinet"><link name="cabinet">{self._body()}</link>'
            f'<link name="{self.kind}">{part}{grip}</link>'
            f'<joint name="moves" type="{joint}<parent link="cabinet"/><child link="{self.kind}"/>'
            f'<origin xyz="{at}"/><limit lower="0" upper="{self.travel:.5f}" effort="9" '
            f'velocity="1"/></joint>{extra}</robot>\n'
        )
        return path

    def _body(self) -> str:
        w, h, d, t = self.width, self.height, self.depth, self.thick
        return "".join(
            (
                box((d, w, t), (0, 0, t / 2)),
                box((d, w, t), (0, 0, h - t / 2)),
                box((d, t, h), (0, w / 2 - t / 2, h / 2)),
                box((d, t, h), (0, -w / 2 + t / 2, h / 2)),
                box((t, w, h), (d / 2 - t / 2, 0, h / 2)),
            )
        )

    def _part(self) -> str:
        w, h, d, t = self.width - 0.004, self.height - 0.004, self.depth, self.thick
        if self.kind == "door":
            return box((t, w, h), (0, -self.hinge * self.width / 2, 0))
        long, wide, tall = 0.9 * d, w - 2 * t - 0.01, 0.6 * h
        side = wide / 2 - 0.005
        return "".join(
            (
                box((t, w, h), (0, 0, 0)),
                box((long, wide, 0.01), (long / 2, 0, -tall / 2)),
                box((long, 0.01, tall), (long / 2, side, 0)),
                box((long, 0.01, tall), (long / 2, -side, 0)),
                box((0.01, wide, tall), (long, 0, 0)),
            )
        )

    def _handle(self) -> str:
        x, y, z = self.handle_at
        front = -self.thick / 2
        stem = ((x + front) / 2, y, z)
        if self.form == "knob":
            cap = rod(self.radius, 0.02, (x + 0.01, y, z), "x")
            return cap + rod(0.006, self.off, stem, "x")
        along, half = ("z", self.length / 2) if self.kind == "door" else ("y", self.length / 2)
        posts = [
            (stem[0], y, z + way * (half - 0.01))
            if along == "z"
            else (stem[0], y + way * (half - 0.01), z)
            for way in (1, -1)
        ]
        post = (self.off, 1.6 * self.radius, 1.6 * self.radius)
        bar = rod(self.radius, self.length, (x, y, z), along)
        return bar + "".join(box(post, at) for at in posts)
