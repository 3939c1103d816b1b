"""The light in 3D pictures: a sun with shadows, ambient occlusion, and drawn edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter

from semmap.arrays import Floats
from semmap.draw.rasteriser import Camera, nearest_triangles

Pixels = NDArray[np.int64]

_SUN_AZIMUTH, _SUN_ELEVATION = np.deg2rad(-145.0), np.deg2rad(52.0)
_SUN, _SKY, _GROUND = 0.70, 0.56, 0.32
_EDGE = 0.62
_SHADOW_MAP = 1600


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The triangles of a picture, one row per triangle."""

    triangles: Floats  # (F, 3, 3), metres in the map's frame
    colours: Floats  # (F, 3), sRGB in 0..1
    owners: NDArray[np.int32]  # (F,) edges are drawn between two owners
    cuts: Floats  # (F,) height above which it is cut away, inf for none
    caps: NDArray[np.bool_]  # (F,) its back, seen through the cut, is shown as the cut


def shade(
    camera: Camera, surfaces: Surfaces, background: Floats, cap: Floats, occlusion: float = 0.45
) -> tuple[NDArray[np.float32], Floats]:
    """Return a picture (height, width, 3) of surfaces, and its depths towards the eye, metres.

    Colours are sRGB in 0..1, depths -inf where nothing is seen. Surfaces occlude the light of the
    sky within `occlusion` metres; `cap` is the colour of cuts.
    """
    face, depth = nearest_triangles(camera, surfaces.triangles, surfaces.cuts)
    seen = face >= 0
    picture = np.empty((*face.shape, 3), np.float32)
    picture[:] = background
    if not seen.any():
        return picture, depth

    outward = _normals(surfaces.triangles)
    turned = outward @ camera.back < 0
    normal = np.where(turned[:, None], -outward, outward)
    f = face[seen]
    light = Camera.look(
        _SUN_AZIMUTH, _SUN_ELEVATION, surfaces.triangles.reshape(-1, 3), _SHADOW_MAP
    )
    open_sky = _ambient(camera, face, depth, normal, occlusion)[seen]
    lit = (
        np.clip(normal @ light.back, 0, None).astype(np.float32)[f]
        * _sunlit(camera, light, surfaces, face, depth, normal)[seen]
    )
    sky = (_GROUND + (_SKY - _GROUND) * (0.5 + 0.5 * normal[:, 2])).astype(np.float32)[f]
    brightness = sky * open_sky + _SUN * lit * (0.4 + 0.6 * open_sky)
    colour = _to_linear(surfaces.colours).astype(np.float32)[f]
    colour *= brightness[:, None]
    colour[:, 0] *= np.float32(1.02)  # a warm sun, a cool sky
    colour[:, 2] *= np.float32(0.985) + np.float32(0.03) * open_sky
    is_cap = (surfaces.caps & turned)[f]
    colour[is_cap] = _to_linear(cap[None])[0]
    picture[seen] = _to_srgb(colour)

    capped = np.where((surfaces.caps & turned)[:, None], 9.0, normal)
    edge = _edges(camera, face, depth, capped, surfaces.owners)
    picture *= np.where(edge, np.float32(_EDGE), np.float32(1.0))[..., None]
    return picture, depth


def _normals(triangles: Floats) -> Floats:
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(n, axis=1, keepdims=True)
    unit: Floats = n / np.where(length == 0, 1.0, length)
    return unit


def _positions(camera: Camera, y: Pixels, x: Pixels, depth: Floats) -> Floats:
    """The (N, 3) points that pixels show, in the map's frame."""
    width, height = camera.size
    along_right = (x + 0.5 - width / 2) / camera.scale + camera.centre[0]
    along_up = (height / 2 - y - 0.5) / camera.scale + camera.centre[1]
    points: Floats = (
        along_right[:, None] * camera.right
        + along_up[:, None] * camera.up
        + depth[:, None] * camera.back
    )
    return points


def _sunlit(
    camera: Camera,
    light: Camera,
    surfaces: Surfaces,
    face: NDArray[np.int32],
    depth: Floats,
    normal: Floats,
) -> NDArray[np.float32]:
    """(height, width) share of the sun's light: a shadow map, sampled at half resolution."""
    _, shadow = nearest_triangles(light, surfaces.triangles, surfaces.cuts)
    half = face[::2, ::2]
    y, x = np.nonzero(half >= 0)
    points = _positions(camera, 2 * y, 2 * x, depth[::2, ::2][y, x])
    at = light.project(points + 0.02 * normal[half[y, x]])
    slack = 0.01 + 1.5 / light.scale
    lit = np.zeros(len(at))
    taps = [(dx, dy) for dx in (-1.2, 0, 1.2) for dy in (-1.2, 0, 1.2)]
    for dx, dy in taps:
        column = np.clip(at[:, 0] + dx, 0, light.size[0] - 1).astype(np.int64)
        row = np.clip(at[:, 1] + dy, 0, light.size[1] - 1).astype(np.int64)
        lit += shadow[row, column] <= at[:, 2] + slack
    whole = np.ones(half.shape, np.float32)
    whole[y, x] = lit / len(taps)
    return _enlarged(whole, 2, face.shape)


def _enlarged(
    image: NDArray[np.float32], times: int, shape: tuple[int, ...]
) -> NDArray[np.float32]:
    """Each pixel `times` x `times`, cut to the shape."""
    return np.repeat(np.repeat(image, times, axis=0), times, axis=1)[: shape[0], : shape[1]]


def _ambient(
    camera: Camera, face: NDArray[np.int32], depth: Floats, normal: Floats, radius: float
) -> NDArray[np.float32]:
    """(height, width) share of the sky's light, estimated from the depths around each pixel."""
    whole = face.shape
    face, depth = face[::4, ::4], np.maximum(depth[::4, ::4], -1e9)
    shape = face.shape
    scale = camera.scale / 4
    n = normal[np.maximum(face, 0)].reshape(-1, 3)
    facing = np.maximum(n @ camera.back, 0.15)
    slope_x = -(n @ camera.right) / facing / scale  # of depth, per pixel, on the surface itself
    slope_y = (n @ camera.up) / facing / scale
    slope_x, slope_y = slope_x.reshape(shape), slope_y.reshape(shape)
    hidden = np.zeros(shape)
    total = 0.0
    reach = int(np.ceil(radius * scale)) + 1
    around = np.pad(depth, reach, constant_values=-1e9)  # far away beyond the border
    for ring, weight in ((0.25, 1.0), (0.6, 0.8), (1.0, 0.6)):
        for angle in np.arange(8) * np.pi / 4 + ring:
            dx, dy = (
                round(float(v) * radius * ring * scale) for v in (np.cos(angle), np.sin(angle))
            )
            there = around[reach + dy :, reach + dx :][: shape[0], : shape[1]]
            above = there - (depth + slope_x * dx + slope_y * dy)
            near = np.exp(-np.clip(above - radius, 0, None) / radius)
            hidden += weight * np.clip((above - 0.01) / (0.6 * radius * ring + 0.02), 0, 1) * near
            total += weight
    opened = np.clip(1.0 - 1.35 * gaussian_filter(hidden / total, 0.8), 0.15, 1.0)
    return _enlarged(opened.astype(np.float32), 4, whole)


def _edges(
    camera: Camera,
    face: NDArray[np.int32],
    depth: Floats,
    normal: Floats,
    owners: NDArray[np.int32],
) -> NDArray[np.bool_]:
    """(height, width) where owners meet, surfaces bend or one lies well behind another."""
    edge = np.zeros(face.shape, bool)
    far = 6.0 / camera.scale + 0.28
    for axis in (0, 1):
        a = tuple(slice(None, -1) if i == axis else slice(None) for i in (0, 1))
        b = tuple(slice(1, None) if i == axis else slice(None) for i in (0, 1))
        at = np.nonzero(face[a] != face[b])
        f, g = face[a][at], face[b][at]
        gap = np.abs(np.maximum(depth[a][at], -1e6) - np.maximum(depth[b][at], -1e6))
        bend = np.einsum("ni,ni->n", normal[f], normal[g])
        apart = (np.where(f >= 0, owners[f], -1) != np.where(g >= 0, owners[g], -1)) & (gap > 0.004)
        edge[a][at] |= apart | (bend < 0.55) | ((gap > far) & (bend < 0.98))
    crowded = uniform_filter(edge.astype(np.float32), 9) >= 0.5
    found: NDArray[np.bool_] = edge & ~crowded
    return found


def _to_linear(colour: Floats) -> Floats:
    return np.asarray(colour, float) ** 2.2


_SRGB = (np.linspace(0, 1, 4096) ** (1 / 2.2)).astype(np.float32)


def _to_srgb(colour: NDArray[np.float32]) -> NDArray[np.float32]:
    out: NDArray[np.float32] = _SRGB[
        np.minimum(colour * np.float32(4095), np.float32(4095)).astype(np.uint16)
    ]
    return out
