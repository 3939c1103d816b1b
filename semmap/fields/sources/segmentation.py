"""People and objects from labelled depth images (reMap, sections 5.2.1 and 5.2.3)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from semmap.fields.checks import as_rigid_rows, positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.sources.percepts import Segmentation
from semmap.snake_case import snake_case
from semmap_vdb import Int32Grid


class _LabelSource:
    """Makes an int32 map of the voxels in which the points of pixels lie, with their labels."""

    takes = Segmentation
    property_name: str

    def __init__(
        self, vocabulary: Vocabulary, *, voxel_size: float = 0.05, farthest: float = 10.0
    ) -> None:
        self._property = vocabulary[self.property_name]
        self.provides = (self.property_name,)
        self._voxel_size = positive(voxel_size, "voxel_size")
        self._farthest = positive(farthest, "farthest")

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
            raise ValueError("intrinsics: give fx, fy, cx, cy in pixels, fx and fy above 0")
        grid = Int32Grid.of_labels(
            depth,
            labels,
            (fx, fy, cx, cy),
            as_rigid_rows(percept.pose, "pose"),
            self._farthest,
            self._voxel_size,
        )
        legend = names or {0: "nothing"}
        return RepresentationMap(self._property, grid, legend=legend, time=percept.time)


class ObjectSource(_LabelSource):
    """Makes an int32 map of `containsObject` from labels that are classes of objects.

    `Wine Glass`, `wine glass` and `WineGlass` are the type `wine_glass`. Types in `ignored` are
    left out, and pixels of a depth above `farthest` metres.
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
        """Return the map of an image."""
        names = {number: snake_case(name) for number, name in percept.names.items()}
        kept = {number: name for number, name in names.items() if name not in self._ignored}
        return [self._map(percept, kept)]


class PeopleSource(_LabelSource):
    """Makes an int32 map of `containsPerson` from labels that are names of people.

    Pixels of a depth above `farthest` metres are left out.
    """

    property_name = "containsPerson"

    def __call__(self, percept: Segmentation) -> list[RepresentationMap]:
        """Return the map of an image."""
        return [self._map(percept, dict(percept.names))]


def _chosen(
    labels: NDArray[np.int32], known: Collection[int], wanted: Collection[int]
) -> NDArray[np.int32]:
    """Return the labels with 0 in place of those that are not wanted; all must be known."""
    top = int(labels.max(initial=0))
    if labels.min(initial=0) < 0 or top > 1 << 20:
        raise ValueError("labels: give integers from 0, for no label, to about a million")
    there = np.bincount(labels.ravel(), minlength=1) > 0
    unknown = set(np.flatnonzero(there).tolist()) - {0, *known}
    if unknown:
        raise ValueError(f"labels {sorted(unknown)} have no name: give a name for each label")
    table = np.zeros(top + 1, np.int32)
    for label in wanted:
        if label <= top:
            table[label] = label
    return table[labels]
