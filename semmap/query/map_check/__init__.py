"""Judge a map by its poses, meshes and outlines, not by the holders that were derived of them."""

from semmap.query.map_check.rules import Finding, check_map

__all__ = ["Finding", "check_map"]
