"""Costmaps as files that a Nav2 stack loads unchanged.

`map_server` loads each map; the static layer of `costmap_2d` takes the master costmap, and its
filters take the masks. ``trinary_costmap: false`` is a parameter of the costmap: one of the layer
has no effect, and each cost below lethal would be free.

Why: docs/decisions/the_master_costmap_is_written_with_253_as_lethal.md
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

from navgrid.field_layer import field_lists
from navgrid.grid import as_cells, file_name, frame_name
from navgrid.inflation import INSCRIBED, LETHAL, UNKNOWN
from navgrid.launch_files import BRINGUP, FRAMES, ros_name, write_storey_launch
from navgrid.map_file import Mode, write_map
from navgrid.masks import Mask, keepout_mask, speed_mask
from semmap.query.geometry_notes import geometry_lists
from semmap.robot import footprint_string
from semmap.whole_file import write_whole

if TYPE_CHECKING:
    from navgrid.costmap import Costmap

Files: TypeAlias = dict[str, Any]
"""The content of ``costmap.json``."""


def as_occupancy(costs: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Return costs of costmap_2d as values of an occupancy grid, as a static layer reads them back.

    100 for the costs 253 and 254, where a robot without footprint must not be; lower costs as
    ``cost * 100 / 254``, at least 1 above 0 and at most 98, since newer versions of Nav2 read 99 as
    253; -1 for unknown. Arrays of one shape, int8.
    """
    found: NDArray[np.int8] = np.ceil(costs * (100 / LETHAL)).clip(0, 98).astype(np.int8)
    found[costs >= INSCRIBED] = 100
    found[costs == UNKNOWN] = -1
    return found


def write_nav2(costmap: Costmap, folder: Path, *, laser_height: float = 0.25) -> Files:
    """Write all maps of a costmap, parameters, launch files and ``costmap.json`` into a folder.

    The localisation map is the section `laser_height` metres above the floor. Returns the content
    of ``costmap.json``. ValueError if two maps would have the same name in ROS.
    """
    _check_names(costmap)
    folder.mkdir(parents=True, exist_ok=True)
    grid, frame = costmap.grid, frame_name(costmap.scene.storey)
    notes = costmap.notes
    maps: dict[str, str] = {}

    def write(name: str, cells: NDArray[np.int8], mode: Mode = "trinary") -> None:
        path = write_map(grid, cells, folder / name, mode, image_format="pgm", comments=notes)
        maps[name] = path.name

    write("master", as_occupancy(costmap.master), "raw")
    for number, part in enumerate(costmap.parts):
        write(part.name, as_occupancy(costmap.costs[number]), "raw")
        for layer, cells in costmap.occupied.items():
            if layer not in costmap.fields:
                write(f"{part.name}_{layer}", as_cells(cells[number], costmap.unknown))
        for place, field in enumerate(costmap.field_layers, 1):
            name = f"{part.name}_field{place}_{file_name(field.name)}"
            if field.is_social:
                write(name, as_occupancy(costmap.social[field.name][number]), "raw")
            else:
                cells = costmap.occupied[field.name]
                write(name, as_cells(cells[number], costmap.unknown))
    write("localisation", as_cells(costmap.section(laser_height), costmap.unknown))
    entities = costmap.scene.entities
    found = {"keepout_mask": keepout_mask(entities, grid), "speed_mask": speed_mask(entities, grid)}
    masks = {name: mask for name, mask in found.items() if mask is not None}
    for name, mask in masks.items():
        write(name, mask.cells, "raw")
    paths = {name: str((folder / file).resolve()) for name, file in maps.items()}
    params = _params(costmap, paths, masks, frame)
    head = _HEAD + "".join(f"# {note}\n" for note in notes)
    write_whole(folder / "nav2_params.yaml", head + yaml.safe_dump(params, sort_keys=False))
    write_storey_launch(folder, params, frame, costmap.scene.elevation)
    files: Files = {
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
            }
            for part in costmap.parts
        ],
        "posture": costmap.posture,
        "maps": maps,
        "params": "nav2_params.yaml",
        "bringup": BRINGUP,
        "frames": FRAMES,
        "lethal": int((costmap.master == LETHAL).sum()),
        "inscribed": int((costmap.master == INSCRIBED).sum()),
        "unknown": int((costmap.master == UNKNOWN).sum()),
        "some_headings": some_headings(costmap),
        **geometry_lists(costmap.scene.entities),
        **field_lists(costmap.field_layers, costmap.fields_without_rule),
    }
    write_whole(folder / "costmap.json", json.dumps(files, indent=1) + "\n")
    return files


def _check_names(costmap: Costmap) -> None:
    """Raise ValueError for a part whose map or node would replace another one."""
    taken = {"keepout_filter_info", "keepout_mask", "localisation", "map", "master"}
    taken |= {"speed_filter_info", "speed_mask"}
    for part in costmap.parts:
        for name in (part.name, *(f"{part.name}_{layer}" for layer in costmap.occupied)):
            if ros_name(name) in taken:
                raise ValueError(
                    f"part {part.name}: another map has the name {ros_name(name)} in ROS, too: "
                    "rename the part"
                )
            taken.add(ros_name(name))


def some_headings(costmap: Costmap) -> int:
    """The cells below 253 in which the robot fits at some headings, not at all of them."""
    fits = np.bitwise_and.reduce(costmap.fits)
    return int(((costmap.master < INSCRIBED) & (fits != np.iinfo(fits.dtype).max)).sum())


_HEAD = """# Parameters for Nav2 to load these maps; merge them into your own. "ros2 launch
# bringup.launch.xml" serves all of them, with paths of its own folder.
# In the master costmap the robot is a point: do not inflate it again. It is blocked where the
# robot's shape fits at no heading; in as many cells as "some_headings" in costmap.json counts, it
# fits at some, not all: there, only planners that check the robot's footprints are sure.
"""


def _params(
    costmap: Costmap, paths: dict[str, str], masks: dict[str, Mask], frame: str
) -> dict[str, Any]:
    """The parameters by node, each under ``ros__parameters``, as rcl requires."""

    def server(name: str, topic: str) -> dict[str, Any]:
        return _node(yaml_filename=paths[name], topic_name=topic, frame_id=frame)

    layers: dict[str, Any] = {
        "global_frame": frame,
        "resolution": costmap.grid.resolution,
        "track_unknown_space": True,
        "robot_radius": round(costmap.grid.resolution / 2, 6),
        "trinary_costmap": False,
        "lethal_cost_threshold": 100,
        "plugins": ["static_layer"],
        "static_layer": {
            "plugin": "nav2_costmap_2d::StaticLayer",
            "map_topic": "/master",
            "map_subscribe_transient_local": True,
        },
    }
    if masks:
        layers["filters"] = [name.removesuffix("_mask") + "_filter" for name in masks]
    params: dict[str, Any] = {
        "global_costmap": {"global_costmap": {"ros__parameters": layers}},
        "master_server": server("master", "master"),
        "map_server": server("localisation", "map"),
        "amcl": _node(global_frame_id=frame),
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
        params[f"{kind}_filter_info_server"] = _node(
            type=mask.type,
            filter_info_topic=f"/{kind}_filter_info",
            mask_topic=f"/{kind}_mask",
            base=0.0,
            multiplier=float(mask.multiplier),
        )
    for name in paths:
        if name in ("master", "localisation", *masks):
            continue
        params[f"{ros_name(name)}_server"] = server(name, f"layers/{ros_name(name)}")
    # For planners that check footprints.
    params["robot_footprints"] = _node(
        **{part.name: footprint_string(part) for part in costmap.parts}
    )
    return params


def _node(**parameters: Any) -> dict[str, Any]:
    return {"ros__parameters": parameters}
