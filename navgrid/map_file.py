"""Read and write the map files of Nav2, as map_server and map_saver do.

The first row of the image is the highest y, row 0 of a grid the lowest. Values are those of
`nav_msgs/OccupancyGrid`: 0 free, 100 occupied, -1 unknown, in `scale` and `raw` anything between.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from navgrid.grid import FREE, OCCUPIED, UNKNOWN, Grid, file_name
from navgrid.voxel_cells import SLACK
from semmap.error import Error
from semmap.limits import CONFIG_BYTES, PIXELS
from semmap.whole_file import whole_file
from semmap.yaml_file import check_structure

Mode = Literal["trinary", "scale", "raw"]

ROWS_AT_ONCE = 256
"""Rows of an image that are computed at once: shades take many bytes a pixel."""

_FINEST = 1e-12  # metres a cell: indices of cells stay within 64 bits

# A trinary map's unknown cells are grey 205, whose occupancy 1 - 205/255 = 0.1961 lies below the
# free_thresh of 0.25 that map_saver writes by default: map_server would read them as free.
THRESHOLDS: dict[Mode, tuple[float, float]] = {
    "trinary": (0.196, 0.65),
    "scale": (0.0, 1.0),  # values are read back exactly
    "raw": (0.25, 0.65),  # map_server ignores them
}
_GREY_UNKNOWN, _GREY_FREE, _GREY_OCCUPIED = 205, 254, 0


class MapFileError(Error, ValueError):
    """A map file cannot be used; the message names the file, the element and how to fix it."""

    def __init__(self, path: Path | str, element: str, problem: str, fix: str) -> None:
        self.path, self.element, self.problem, self.fix = str(path), element, problem, fix
        super().__init__(f"{path}: {element}: {problem}. {fix}")


def write_map(
    grid: Grid,
    cells: NDArray[np.int8],
    path_stem: Path | str,
    mode: Mode = "trinary",
    *,
    free_thresh: float | None = None,
    occupied_thresh: float | None = None,
    image_format: Literal["pgm", "png"] | None = None,
    comments: Iterable[str] = (),
) -> Path:
    """Write a map as ``<path_stem>.yaml`` and its image; return the path of the YAML file.

    Each file appears as a whole or not at all.

    Parameters
    ----------
    cells : (rows, columns) int8
        Row 0 is the lowest y. -1 is unknown, 0 to 100 is the occupancy in percent.
    mode : "trinary", "scale" or "raw"
        `trinary` writes cells at or below the free threshold as free, cells at or above the
        occupied threshold as occupied, and all others as unknown.
    free_thresh, occupied_thresh : float, optional
        Written to the YAML file. By default those with which map_server reads the same cells back.
    image_format : "pgm" or "png", optional
        By default png for `scale`, where unknown cells are transparent, else pgm.
    comments : iterable of str
        Lines for the head of the YAML file.

    Raises
    ------
    ValueError
        The cells do not fit the grid or hold other values, or the thresholds are out of order.

    Examples
    --------
    >>> import tempfile
    >>> grid = Grid(origin=(-1.0, 2.0), resolution=0.05, shape=(2, 3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_map(grid, np.array([[0, 100, -1], [0, 0, 0]], np.int8), f"{folder}/map")
    ...     read_map(path)[1].tolist()
    [[0, 100, -1], [0, 0, 0]]
    """
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; give one of {', '.join(get_args(Mode))}")
    cells = np.asarray(cells)
    if cells.shape != tuple(grid.shape):
        raise ValueError(
            f"cells have the shape {cells.shape}, the grid {tuple(grid.shape)}; give equal shapes"
        )
    if cells.size == 0:
        raise ValueError("the grid has no cells; give it a shape of at least 1 x 1")
    if cells.min() < UNKNOWN or cells.max() > OCCUPIED:
        raise ValueError(
            f"cells hold values from {cells.min()} to {cells.max()}; give -1 for unknown, "
            "0 to 100 for occupancy"
        )
    free = THRESHOLDS[mode][0] if free_thresh is None else float(free_thresh)
    occupied = THRESHOLDS[mode][1] if occupied_thresh is None else float(occupied_thresh)
    if not 0.0 <= free < occupied <= 1.0:
        raise ValueError(f"thresholds {free} and {occupied}: give 0 <= free < occupied <= 1")
    image_format = image_format or ("png" if mode == "scale" else "pgm")
    if mode == "scale" and image_format == "pgm" and (cells == UNKNOWN).any():
        raise ValueError("a pgm image has no transparency for unknown cells in scale mode; use png")

    stem = Path(path_stem)
    stem.parent.mkdir(parents=True, exist_ok=True)
    image = stem.with_name(f"{stem.name}.{image_format}")
    description = stem.with_name(f"{stem.name}.yaml")
    pixels = _pixels(cells, mode, free, occupied)[::-1]
    x, y = grid.origin
    head = "".join(f"# {' '.join(line.split())}\n" for line in comments)
    text = head + (
        f"image: {_text(image.name)}\n"
        f"mode: {mode}\n"
        f"resolution: {_number(grid.resolution)}\n"
        f"origin: [{_number(x)}, {_number(y)}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {_number(occupied)}\n"
        f"free_thresh: {_number(free)}\n"
    )
    # Without a description, no reader combines the former origin with the new image.
    description.unlink(missing_ok=True)
    _replace(image, _encoded(pixels, "PPM" if image_format == "pgm" else "PNG"))
    _replace(description, text.encode())
    return description


def read_map(path: Path | str) -> tuple[Grid, NDArray[np.int8]]:
    """Return the grid of a map file (YAML) and its cells, as map_server reads them.

    The cells are (rows, columns) int8, row 0 at the lowest y: -1 is unknown, 0 to 100 is the
    occupancy in percent.

    Raises
    ------
    MapFileError
        The YAML file or its image is missing or malformed, or a value is out of range.
    """
    path = Path(path)
    fields = _description(path)
    mode: Mode = fields.get("mode", "trinary")
    if mode not in get_args(Mode):
        fix = f"Give one of {', '.join(get_args(Mode))}"
        raise MapFileError(path, "mode", f"is {mode!r}", fix)
    resolution = _float(path, "resolution", _required(path, fields, "resolution"))
    if not _FINEST <= resolution <= 1 / _FINEST:
        fix = f"Give metres a cell, {_FINEST:g} to {1 / _FINEST:g}"
        raise MapFileError(path, "resolution", f"is {resolution}", fix)
    origin = _required(path, fields, "origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapFileError(path, "origin", f"is {origin!r}", "Give a list [x, y, yaw]")
    x, y, yaw = (_float(path, f"origin[{i}]", v) for i, v in enumerate(origin))
    if yaw != 0.0:
        raise MapFileError(
            path,
            "origin[2]",
            f"is a yaw of {yaw} radians, which grids do not have",
            "Turn the image and give yaw 0",
        )
    negate = bool(_float(path, "negate", _required(path, fields, "negate")))
    free = _float(path, "free_thresh", fields.get("free_thresh", 0.25))
    occupied = _float(path, "occupied_thresh", fields.get("occupied_thresh", 0.65))
    name = _required(path, fields, "image")
    if not isinstance(name, str) or not name:
        raise MapFileError(path, "image", f"is {name!r}", "Give the image's file name")
    pixels, opaque = _image(path, path.parent / name)
    shape = (pixels.shape[0], pixels.shape[1])
    cells = np.empty(shape, np.int8)
    for first in range(0, len(cells), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        shades = _shades(pixels[rows], opaque)
        cells[rows] = _cells(*shades, mode, negate, free, occupied)
    cells = cells[::-1]
    grid = Grid(origin=(x, y), resolution=resolution, shape=shape)
    return grid, np.ascontiguousarray(cells)


def _pixels(cells: NDArray[np.int8], mode: Mode, free: float, occupied: float) -> NDArray[np.uint8]:
    """(rows, columns) grey, or (rows, columns, 2) grey and alpha for `scale` with unknown cells."""
    unknown = cells == UNKNOWN
    if mode == "raw":
        return cells.astype(np.uint8)  # unknown cells, -1, are 255
    if mode == "scale":
        grey = np.rint(255 * (100 - cells.astype(float).clip(0)) / 100).astype(np.uint8)
        if not unknown.any():
            return grey
        return np.stack([grey, np.where(unknown, 0, 255).astype(np.uint8)], axis=-1)
    pixels = np.full(cells.shape, _GREY_UNKNOWN, np.uint8)
    pixels[~unknown & (cells <= round(100 * free))] = _GREY_FREE
    pixels[cells >= round(100 * occupied)] = _GREY_OCCUPIED
    return pixels


def _shades(
    pixels: NDArray[Any], opaque: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, int]:
    """Mean shade over the colour channels, alpha, and the number of colour channels."""
    shades = pixels / (255 if pixels.dtype == np.uint8 else 65535)
    if shades.ndim == 2:
        return shades, None, 1
    if opaque:
        return shades.mean(axis=-1), None, shades.shape[-1]
    return shades[..., :-1].mean(axis=-1), shades[..., -1], shades.shape[-1] - 1


def _cells(
    shade: NDArray[np.float64],
    alpha: NDArray[np.float64] | None,
    channels: int,
    mode: Mode,
    negate: bool,
    free: float,
    occupied: float,
) -> NDArray[np.int8]:
    """Occupancy of shades (0 black .. 1 white), by the documented rules of map_server."""
    if mode == "raw":
        percent = np.rint(shade * 255)
        return np.where(percent <= OCCUPIED, percent, UNKNOWN).astype(np.int8)
    if mode == "trinary" and alpha is not None:  # the alpha channel counts as a shade
        shade = (shade * channels + alpha) / (channels + 1)
    occupancy = shade if negate else 1.0 - shade
    is_occupied, is_free = occupancy > occupied, occupancy < free
    between: NDArray[np.float64] | float = UNKNOWN
    if mode == "scale":
        width = occupied - free if occupied > free else math.inf
        between = np.rint((occupancy - free) / width * 100).clip(0, 100)
        if alpha is not None:
            between = np.where(alpha < 1.0, UNKNOWN, between)
            is_occupied, is_free = is_occupied & (alpha >= 1.0), is_free & (alpha >= 1.0)
    return np.select([is_occupied, is_free], [OCCUPIED, FREE], between).astype(np.int8)


def _image(path: Path, image: Path) -> tuple[NDArray[Any], bool]:
    """The pixels (rows, columns) or (rows, columns, channels), and whether there is no alpha."""

    def refused(problem: str, fix: str) -> MapFileError:
        return MapFileError(image, "image", problem, fix.removesuffix("."))

    try:
        with Image.open(image) as file:
            PIXELS.check(math.prod(file.size), refused, "Take a coarser resolution.")
            wide = file.mode.startswith("I")
            opaque = file.mode in ("1", "L", "RGB") or wide
            if file.mode in ("1", "P"):
                file_ = file.convert("RGBA" if "transparency" in file.info else "RGB")
            elif file.mode in ("L", "LA", "RGB", "RGBA") or wide:
                file_ = file
            else:
                file_ = file.convert("RGB")
            opaque = opaque or file_.mode == "RGB"
            pixels = np.asarray(file_)
    except FileNotFoundError:
        fix = f"Put the image there or correct image: in {path.name}"
        raise MapFileError(path, "image", f"there is no {image}", fix) from None
    except MapFileError:
        raise
    except Exception as error:  # decoders raise anything on broken bytes, SyntaxError among it
        raise refused(f"cannot be read ({error})", "Save it again as PGM, PNG or BMP") from None
    return pixels, opaque


def _description(path: Path) -> dict[str, Any]:
    def refused(problem: str, fix: str) -> MapFileError:
        return MapFileError(path, "file", problem, fix.removesuffix("."))

    try:
        CONFIG_BYTES.check(path.stat().st_size, refused, "Give the .yaml file of a map.")
        text = path.read_text(encoding="utf-8")
        check_structure(text, lambda line, problem, fix: refused(f"line {line} {problem}", fix))
        fields = yaml.safe_load(text)
    except MapFileError:
        raise
    except FileNotFoundError:
        raise refused("does not exist", "Give the .yaml file of a map") from None
    except (OSError, ValueError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise refused(f"is not valid YAML ({reason})", "Correct it") from None
    if not isinstance(fields, dict):
        raise MapFileError(path, "file", "has no fields", "Give the .yaml file of a map")
    return fields


def _required(path: Path, fields: dict[str, Any], name: str) -> Any:
    if fields.get(name) is None:
        raise MapFileError(path, name, "is missing", f"Add a line {name}: ...")
    return fields[name]


def _float(path: Path, element: str, value: Any) -> float:
    try:
        number = math.nan if value is True and element != "negate" else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise MapFileError(path, element, f"is {value!r}", "Give a finite number")
    return number


def _number(value: float) -> str:
    """The shortest text that YAML reads back as this float; YAML 1.1 needs a dot."""
    text = repr(float(value))
    return text if "e" not in text or "." in text else text.replace("e", ".0e")


def _text(value: str) -> str:
    return value if re.fullmatch(r"[A-Za-z][A-Za-z0-9_.-]*", value) else json.dumps(value)


def _encoded(pixels: NDArray[np.uint8], form: str) -> bytes:
    buffer = BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, format=form)
    return buffer.getvalue()


def _replace(path: Path, content: bytes) -> None:
    """Write a file in one step: a complete one is renamed to it."""
    with whole_file(path) as made, made.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def folder_of(storey: str, folder: Path, storeys: int) -> Path:
    """Return the folder for a storey's files: one below `folder` where there are several."""
    return folder if storeys == 1 else folder / file_name(storey)


def map_layer(path: Path | str, grid: Grid, threshold: int = 65) -> NDArray[np.bool_]:
    """Return the (rows, columns) bool cells of a grid that occupied cells of a map file overlap.

    Those are occupied that have at least `threshold` percent; unknown cells are not. Raises
    `MapFileError`.
    """
    found, cells = read_map(path)
    return resampled(found, cells >= threshold, grid)


def resampled(source: Grid, occupied: NDArray[np.bool_], grid: Grid) -> NDArray[np.bool_]:
    """Return the (rows, columns) bool cells of `grid` that occupied cells of `source` overlap."""
    # of occupied cells below and left: its differences are the numbers in rectangles
    counts = np.zeros((occupied.shape[0] + 1, occupied.shape[1] + 1), np.int32)
    counts[1:, 1:] = occupied.cumsum(0, np.int32).cumsum(1, np.int32)
    ratio = grid.resolution / source.resolution
    ranges = []
    for axis, most in enumerate(occupied.shape[::-1]):
        offset = (grid.origin[axis] - source.origin[axis]) / source.resolution
        low = offset + np.arange(grid.shape[::-1][axis]) * ratio
        begin, end = np.floor(low + SLACK * ratio), np.ceil(low + (1 - SLACK) * ratio)
        ranges.append([np.clip(each, 0, most).astype(int) for each in (begin, end)])
    (left, right), (below, above) = ranges
    upper, lower = counts[above], counts[below]
    found: NDArray[np.bool_] = upper[:, right] - upper[:, left] > lower[:, right] - lower[:, left]
    return found
