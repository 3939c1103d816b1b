"""People and objects: masks in a depth image (reMap, sections 5.2.1 and 5.2.3)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from semmap.fields.regions import _above_0, _rigid
from semmap.fields.representation_map import RepresentationMap
from semmap.fields.sources.percepts import Segmentation
from semmap.fields.vocabulary import Vocabulary
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
        unknown = set(np.unique(labels).tolist()) - {0, *percept.names}
        if unknown:
            raise ValueError(f"labels hold {sorted(unknown)}, which have no name: name all")
        if len(names) < len(percept.names):
            labels = np.where(np.isin(labels, [*names]), labels, 0).astype(np.int32)
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
