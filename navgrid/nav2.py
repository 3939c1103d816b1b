"""Costmaps as files that a Nav2 stack loads unchanged.

`map_server` loads each map; `costmap_2d`'s static layer takes the master as terrain (with
``trinary_costmap: false``), its filters the masks.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from navgrid.costmap import Costmap
from navgrid.inflation import INSCRIBED, LETHAL, UNKNOWN
from navgrid.map_file import Mode, write_map
from navgrid.masks import Mask, keepout_mask, speed_mask
from semmap.robot import footprint_string

__all__ = ["Files", "as_occupancy", "frame_name", "write_nav2"]

Files = dict[str, Any]


def as_occupancy(costs: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Costs as a static layer reads them back: 100 where the robot's origin must not be.

    That is at 253 and 254: a dot-shaped robot has no footprint to be checked with. Lower costs
    are ``cost * 100 / 254``, at least 1 above 0; unknown is -1.
    """
    found: NDArray[np.int8] = np.ceil(costs * (100 / LETHAL)).clip(0, 99).astype(np.int8)
    found[costs >= INSCRIBED] = 100
    found[costs == UNKNOWN] = -1
    return found


def frame_name(storey: str) -> str:
    """The frame in which a storey's maps are, as tf takes its names."""
    return "map_" + (re.sub(r"\W+", "_", storey).strip("_") or "storey")


def write_nav2(costmap: Costmap, folder: Path, *, laser_height: float = 0.25) -> Files:
    """Write all maps of a costmap into a folder, and ``nav2_params.yaml``; what was written.

    Parameters
    ----------
    laser_height : metres above the floor, of the localisation map
    """
    folder.mkdir(parents=True, exist_ok=True)
    grid, frame = costmap.grid, frame_name(costmap.scene.storey)
    maps: dict[str, str] = {}

    def keep(name: str, cells: NDArray[np.int8], mode: Mode = "trinary") -> None:
        maps[name] = write_map(grid, cells, folder / name, mode, image_format="pgm").name

    keep("master", as_occupancy(costmap.master), "raw")
    for number, part in enumerate(costmap.parts):
        keep(part.name, as_occupancy(costmap.costs[number]), "raw")
        for layer, cells in costmap.occupied.items():
            keep(f"{part.name}_{layer}", _occupied(cells[number], costmap.unknown))
    keep("localisation", _occupied(costmap.section(laser_height), costmap.unknown))
    masks = {
        name: mask
        for name, mask in (
            ("keepout_mask", keepout_mask(costmap.scene.things, grid)),
            ("speed_mask", speed_mask(costmap.scene.things, grid)),
        )
        if mask is not None
    }
    for name, mask in masks.items():
        keep(name, mask.cells, "raw")
    params = _params(costmap, maps, masks, frame)
    (folder / "nav2_params.yaml").write_text(_HEAD + yaml.safe_dump(params, sort_keys=False))
    said: Files = {
        "storey": costmap.scene.storey,
        "frame": frame,
        "elevation": costmap.scene.elevation,
        "resolution": grid.resolution,
        "origin": list(grid.origin),
        "width": grid.shape[1],
        "height": grid.shape[0],
        "parts": [
            {
                "name": part.name,
                "interval": [float(v) for v in part.interval],
                "footprint": [[float(v) for v in corner] for corner in part.footprint],
                "inscribed_radius": float(part.inscribed_radius),
                "circumscribed_radius": float(part.circumscribed_radius),
                "inflate_by": part.inflate_by,
            }
            for part in costmap.parts
        ],
        "maps": maps,
        "params": "nav2_params.yaml",
        "lethal": int((costmap.master == LETHAL).sum()),
        "inscribed": int((costmap.master == INSCRIBED).sum()),
        "unknown": int((costmap.master == UNKNOWN).sum()),
    }
    (folder / "costmap.json").write_text(json.dumps(said, indent=1) + "\n")
    return said


def _occupied(cells: NDArray[np.bool_], unknown: NDArray[np.bool_]) -> NDArray[np.int8]:
    found = np.where(cells, 100, 0).astype(np.int8)
    found[unknown & ~cells] = -1
    return found


_HEAD = """# What Nav2 has to be told of these maps; merge it into your own parameters.
# The master is the terrain of a dot-shaped robot: do not inflate it again.
"""


def _params(
    costmap: Costmap, maps: dict[str, str], masks: dict[str, Mask], frame: str
) -> dict[str, Any]:
    def server(name: str, topic: str) -> dict[str, Any]:
        return {
            "ros__parameters": {"yaml_filename": maps[name], "topic_name": topic, "frame_id": frame}
        }

    filters = [name.removesuffix("_mask") + "_filter" for name in masks]
    layers: dict[str, Any] = {
        "global_frame": frame,
        "resolution": costmap.grid.resolution,
        "track_unknown_space": True,
        "robot_radius": round(costmap.grid.resolution / 2, 6),
        "plugins": ["static_layer"],
        "static_layer": {
            "plugin": "nav2_costmap_2d::StaticLayer",
            "map_topic": "/master",
            "map_subscribe_transient_local": True,
            "trinary_costmap": False,
            "lethal_cost_threshold": 100,
        },
    }
    if filters:
        layers["filters"] = filters
    params: dict[str, Any] = {
        "global_costmap": {"global_costmap": {"ros__parameters": layers}},
        "master_server": server("master", "master"),
        "map_server": server("localisation", "map"),
    }
    for name, mask in masks.items():
        kind = name.removesuffix("_mask")
        plugin = "KeepoutFilter" if kind == "keepout" else "SpeedFilter"
        layers[f"{kind}_filter"] = {
            "plugin": f"nav2_costmap_2d::{plugin}",
            "enabled": True,
            "filter_info_topic": f"/{kind}_filter_info",
        }
        if kind == "speed":
            layers[f"{kind}_filter"]["speed_limit_topic"] = "/speed_limit"
        params[f"{kind}_mask_server"] = server(name, f"{kind}_mask")
        params[f"{kind}_filter_info_server"] = {
            "ros__parameters": {
                "type": mask.type,
                "filter_info_topic": f"/{kind}_filter_info",
                "mask_topic": f"/{kind}_mask",
                "base": float(mask.base),
                "multiplier": float(mask.multiplier),
            }
        }
    # For who plans with footprints: the hull of each part, and of all of them.
    params["footprints"] = {part.name: footprint_string(part) for part in costmap.parts}
    return params
