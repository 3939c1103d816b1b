"""Judge a map by its poses, meshes and outlines, not by the holders that were derived of them."""
