"""People and objects: masks in a depth image (reMap, sections 5.2.1 and 5.2.3)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from semmap.fields.regions.shapes import _above_0, _rigid
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.sources.percepts import Segmentation
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.ingest.tbox import snake_case
from semmap_vdb import Int32Grid

__all__ = ["ObjectSource", "PeopleSource"]


class _Seen:
    """Voxels in which pixels lie, each with the number of what they show."""

    property_name: str

    def __init__(
        self, vocabulary: Vocabulary, *, voxel_size: float = 0.05, farthest: float = 10.0
    ) -> None:
        self._property = vocabulary[self.property_name]
        self._voxel_size = _above_0(voxel_size, "voxel_size")
        self._farthest = _above_0(farthest, "farthest")

    def _map(self, percept: Segmentation, names: dict[int, str]) -> RepresentationMap:
        depth = np.ascontiguousarray(percept.depth, np.float32)
        labels = np.ascontiguousarray(percept.labels, np.int32)
        if depth.ndim != 2 or labels.shape != depth.shape:
            raise ValueError(
                f"labels have shape {labels.shape}, depth {depth.shape}: give two (H, W) arrays"
            )
        labels = _chosen(labels, percept.names, names)
        fx, fy, cx, cy = np.asarray(percept.intrinsics, float).tolist()
        if not (fx > 0 and fy > 0):
            raise ValueError("intrinsics are fx, fy, cx, cy in pixels, fx and fy above 0")
        grid = Int32Grid.of_labels(
            depth, labels, (fx, fy, cx, cy), _rigid(percept.pose, "pose"), self._farthest,
            self._voxel_size,
        )  # fmt: skip
        legend = names or {0: "nothing"}
        return RepresentationMap(self._property, grid, legend=legend, time=percept.time)


class ObjectSource(_Seen):
    """Things seen, by their type: an int32 map of `containsObject`.

    Names of classes are those of the detector: the 80 of COCO, or any. `Wine Glass`, `wine glass`
    and `WineGlass` are the type `wine_glass`. A person is no object.

    Parameters
    ----------
    voxel_size : metres
    farthest : metres of depth beyond which pixels are left out
    ignored : types that are left out
    """

    property_name = "containsObject"

    def __init__(
        self,
        vocabulary: Vocabulary,
        *,
        voxel_size: float = 0.05,
        farthest: float = 10.0,
        ignored: Collection[str] = ("person",),
    ) -> None:
        super().__init__(vocabulary, voxel_size=voxel_size, farthest=farthest)
        self._ignored = frozenset(ignored)

    def __call__(self, percept: Segmentation) -> list[RepresentationMap]:
        names = {number: snake_case(name) for number, name in percept.names.items()}
        kept = {number: name for number, name in names.items() if name not in self._ignored}
        return [self._map(percept, kept)]


class PeopleSource(_Seen):
    """The space that people fill: an int32 map of `containsPerson`, by name."""

    property_name = "containsPerson"

    def __call__(self, percept: Segmentation) -> list[RepresentationMap]:
        return [self._map(percept, dict(percept.names))]


def _chosen(
    labels: NDArray[np.int32], known: Collection[int], wanted: Collection[int]
) -> NDArray[np.int32]:
    """The labels that are wanted, 0 for the others, all of which must be known."""
    top = int(labels.max(initial=0))
    if labels.min(initial=0) < 0 or top > 1 << 20:
        raise ValueError("labels are numbers from 0, nothing, to about a million")
    there = np.bincount(labels.ravel(), minlength=1) > 0
    unknown = set(np.flatnonzero(there).tolist()) - {0, *known}
    if unknown:
        raise ValueError(f"labels hold {sorted(unknown)}, which have no name: name all")
    table = np.zeros(top + 1, np.int32)
    for label in wanted:
        if label <= top:
            table[label] = label
    return table[labels]
