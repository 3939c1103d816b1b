"""The named frames of an SDF scope (a model or a world), and their poses in it.

As of SDFormat 1.7 (http://sdformat.org/tutorials?tut=pose_frame_semantics). A nested model opens
its own scope, whose frames the outer scope calls ``model::frame``.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.sdf.elements import Unusable
from semmap.ingest.world import WorldError


class Frames:
    """The frames of a model or world; `root` is its own, ``__model__`` or ``world``."""

    def __init__(self, path: Path, scope: str, root: str) -> None:
        self._path, self._scope, self._root = path, scope, root
        self._edges: dict[str, tuple[str, Pose]] = {}
        self._inner: dict[str, Frames] = {}
        self._known: dict[str, Pose] = {root: IDENTITY}

    def __contains__(self, name: object) -> bool:
        return name in self._edges

    def add(
        self, name: str, pose: Pose, relative_to: str = "", inner: Frames | None = None
    ) -> None:
        """Add a frame; `inner` is the scope that a nested model opens."""
        self._edges[name] = (relative_to or self._root, pose)
        if inner is not None:
            self._inner[name] = inner

    def check(self) -> None:
        """Raise the WorldError of `pose` if frames of this scope form a circle."""
        for name in self._edges:
            with suppress(Unusable):
                self.pose(name)

    def names(self) -> list[str]:
        """Return all frames of this scope but its own."""
        return list(self._edges)

    def pose(self, name: str, where: str = "") -> Pose:
        """Return the pose of a frame in the scope's own frame; `where` is the element, for errors.

        A WorldError refuses frames in a circle; a frame that leads to none that exists is Unusable.
        """
        chain: list[tuple[str, Pose]] = []
        passed: dict[str, None] = {}
        at = name
        while at not in self._known:
            if at in passed:
                circle = [*list(passed)[list(passed).index(at) :], at]
                raise WorldError(
                    self._path,
                    f"{self._scope}: frame {at}",
                    f"is relative to itself ({' -> '.join(circle)})",
                    "Change relative_to, attached_to or child so that every frame leads to "
                    f"{self._root}.",
                )
            passed[at] = None
            parent, pose = self._edge(at, where or f"{self._scope}: frame {name}")
            chain.append((at, pose))
            at = parent
        world = self._known[at]
        for frame, pose in reversed(chain):
            world = world @ pose
            self._known[frame] = world
        return world

    def _edge(self, name: str, where: str) -> tuple[str, Pose]:
        if name in self._edges:
            return self._edges[name]
        model, _, rest = name.partition("::")
        if rest and model in self._inner:
            return model, self._inner[model].pose(rest, where)
        raise Unusable(
            where,
            f"it is relative to {name!r}, which {self._scope} does not have or cannot place",
            f"Name a link, joint, frame or model of {self._scope}.",
        )
