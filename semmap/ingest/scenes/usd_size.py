"""The size of a USD stage, from its layers: a page can bring its prims in billions of times."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from semmap.ingest.meshes.mesh_size import unfolded
from semmap.ingest.scenes.usd_crate import check_crates
from semmap.ingest.world import WorldError

ARCS = ("referenceList", "payloadList", "inheritPathList", "specializesList")
"""The lists of a prim with others whose content it gets."""


def stage_size(root: Any) -> float:
    """Return the number of prims of a layer's stage at most; inf where one contains itself.

    A prim counts as often as it is brought in, with all its variants. Files that are not there
    count as nothing.
    """
    parts: dict[str, list[str]] = defaultdict(list)
    tops, known = [root], {root.identifier}
    while tops:
        top = tops.pop()
        stack = list(_stack(top, set()))
        for layer in stack:
            specs = list(layer.rootPrims)
            while specs:
                spec = specs.pop()
                path = spec.path.StripAllVariantSelections()
                if _key(top, path) not in parts:
                    parts[_key(top, path.GetParentPath())].append(_key(top, path))
                own = parts[_key(top, path)]
                for at, target in _targets(spec, layer, top):
                    if at.identifier not in known:
                        known.add(at.identifier)
                        tops.append(at)
                    own.append(_key(at, _stated(at, target)))
                specs += spec.nameChildren
                for variants in spec.variantSets.values():
                    specs += (variant.primSpec for variant in variants.variants.values())
    return unfolded(parts, dict.fromkeys(parts, 1), _key(root, root.pseudoRoot.path))


def _stack(layer: Any, seen: set[str]) -> Iterator[Any]:
    """Yield a layer and those below it, each once."""
    if layer is None or layer.identifier in seen:
        return
    seen.add(layer.identifier)
    yield layer
    for path in layer.subLayerPaths:
        yield from _stack(_opened(layer, path), seen)


def _opened(layer: Any, asset: str) -> Any:
    """Return the layer that another one names; None where there is none."""
    from pxr import Sdf, Tf

    file = Path(layer.ComputeAbsolutePath(asset).partition("[")[0])
    check_crates(file, partial(WorldError, file, "file"))
    try:
        return Sdf.Layer.FindOrOpenRelativeToLayer(layer, asset)
    except Tf.ErrorException:  # USD reports it, and reads the stage without
        return None


def _targets(spec: Any, layer: Any, top: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the prims whose content a prim gets: the layer and the path of each."""
    for name in ARCS:
        for arc in getattr(spec, name).GetAddedOrExplicitItems():
            asset = getattr(arc, "assetPath", "")
            at = _opened(layer, asset) if asset else top
            path = getattr(arc, "primPath", arc)
            if at is not None and path.isEmpty:
                path = at.GetDefaultPrimAsPath()
            if at is not None and not path.isEmpty:
                yield at, path.MakeAbsolutePath(spec.path.GetPrimPath())


def _stated(layer: Any, path: Any) -> Any:
    """Return the path of a prim, or of the nearest above it that a layer's stack states."""
    stack = list(_stack(layer, set()))
    while not path.IsAbsoluteRootPath() and not any(each.GetPrimAtPath(path) for each in stack):
        path = path.GetParentPath()
    return path


def _key(layer: Any, path: Any) -> str:
    return f"{layer.identifier}\0{path}"
