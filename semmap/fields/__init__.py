"""Fields: what space contains and means, in sparse grids of voxels (OpenVDB)."""

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.fields.maps.lattice import Lattice as Lattice
    from semmap.fields.maps.map_buffer import MapBuffer as MapBuffer
    from semmap.fields.maps.representation_map import RepresentationMap as RepresentationMap
    from semmap.fields.regions.region_map import Memory as Memory
    from semmap.fields.regions.region_map import Overlap as Overlap
    from semmap.fields.regions.region_map import RegionMap as RegionMap
    from semmap.fields.regions.shaped_region import Box as Box
    from semmap.fields.regions.shaped_region import Cone as Cone
    from semmap.fields.regions.shaped_region import Cylinder as Cylinder
    from semmap.fields.regions.shaped_region import DepthImage as DepthImage
    from semmap.fields.regions.shaped_region import Hull as Hull
    from semmap.fields.regions.shaped_region import Region as Region
    from semmap.fields.regions.shaped_region import Solid as Solid
    from semmap.fields.regions.shaped_region import Sphere as Sphere
    from semmap.fields.regions.shaped_region import SurfaceRegion as SurfaceRegion
    from semmap.fields.regions.shaped_region import voxels_of as voxels_of
    from semmap.language.schema import Property as Property

__getattr__, __all__ = load_on_use(__name__)
