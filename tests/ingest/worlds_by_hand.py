"""Small world files for tests: boxes in SDF, rectangular rooms in GeoJSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

Point = tuple[float, float, float]


def box_world(folder: Path, boxes: dict[str, Point], size: float = 0.8) -> Path:
    """An SDF world of boxes at the given centres: cubes of `size`, those named mug of 0.2 m."""
    folder.mkdir(parents=True, exist_ok=True)
    models = []
    for name, (x, y, z) in boxes.items():
        edge = 0.2 if name.startswith("mug") else size
        models.append(
            f"<model name='{name}'><pose>{x} {y} {z} 0 0 0</pose><link name='l'><visual name='v'>"
            f"<geometry><box><size>{edge} {edge} {edge}</size></box></geometry>"
            "</visual></link></model>"
        )
    path = folder / "boxes.sdf"
    path.write_text(f"<sdf version='1.7'><world name='boxes'>{''.join(models)}</world></sdf>")
    return path


def room_features(rooms: dict[str, tuple[float, float, float, float]]) -> dict[str, Any]:
    """A GeoJSON collection of rectangular rooms (x0, y0, x1, y1), 2.5 m high."""
    features = []
    for name, (x0, y0, x1, y1) in rooms.items():
        ring = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]
        features.append(
            {
                "type": "Feature",
                "properties": {
                    "kind": "room",
                    "name": name,
                    "type": "room",
                    "floor": 0,
                    "ceiling": 2.5,
                },
                "geometry": {"type": "Polygon", "coordinates": [ring]},
            }
        )
    return {"type": "FeatureCollection", "features": features}
