"""IFC files written by IfcOpenShell's own API: boxes for spaces, walls, doors and treads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ifcopenshell.api import (
    aggregate,
    context,
    geometry,
    georeference,
    owner,
    project,
    root,
    spatial,
    unit,
)

Box = tuple[Sequence[float], Sequence[float]]


class BuildingByHand:
    """A building in a schema and a length unit; boxes are given in metres, in the file's frame."""

    def __init__(self, schema: str = "IFC4", prefix: str | None = "MILLI") -> None:
        self.model = project.create_file(version=schema)
        if schema == "IFC2X3":  # demands an author
            person = owner.add_person(self.model)
            organisation = owner.add_organisation(self.model)
            owner.add_person_and_organisation(self.model, person=person, organisation=organisation)
            owner.add_application(self.model)
        self.scale = 1000.0 if prefix == "MILLI" else 1.0
        self.project = root.create_entity(self.model, ifc_class="IfcProject", name="house")
        length = unit.add_si_unit(self.model, unit_type="LENGTHUNIT", prefix=prefix)
        unit.assign_unit(self.model, units=[length])
        whole = context.add_context(self.model, context_type="Model")
        self.body = context.add_context(
            self.model, "Model", "Body", target_view="MODEL_VIEW", parent=whole
        )
        self.building = root.create_entity(self.model, ifc_class="IfcBuilding", name="b")
        aggregate.assign_object(self.model, products=[self.building], relating_object=self.project)

    def storey(self, name: str, z: float) -> Any:
        level = root.create_entity(self.model, ifc_class="IfcBuildingStorey", name=name)
        aggregate.assign_object(self.model, products=[level], relating_object=self.building)
        self._place(level, (0, 0, z), 0.0)
        return level

    def add(
        self, class_: str, name: str, holder: Any, *boxes: Box, yaw: float = 0.0, **given: Any
    ) -> Any:
        """Add a product of boxes from a low to a high corner, turned about the first's low one."""
        product = root.create_entity(self.model, ifc_class=class_, name=name)
        for attribute, value in given.items():
            setattr(product, attribute, value)
        if class_ == "IfcSpace":
            aggregate.assign_object(self.model, products=[product], relating_object=holder)
        else:
            spatial.assign_container(self.model, products=[product], relating_structure=holder)
        if boxes:
            origin = np.asarray(boxes[0][0], float)
            items = [self._solid(np.asarray(box) - origin) for box in boxes]
            self._shape(product, items, origin, yaw)
        return product

    def prism(
        self, class_: str, name: str, holder: Any, corners: Sequence[Sequence[float]], height: float
    ) -> Any:
        """Add a product above an outline (x, y) on the floor of a storey at z 0."""
        product = self.add(class_, name, holder)
        make = self.model.create_entity
        points = [
            make("IfcCartesianPoint", (float(x) * self.scale, float(y) * self.scale))
            for x, y in (*corners, corners[0])
        ]
        profile = make("IfcArbitraryClosedProfileDef", "AREA", None, make("IfcPolyline", points))
        self._shape(product, [self._extruded(profile, 0.0, height * self.scale)], (0, 0, 0), 0.0)
        return product

    def ramp(self, name: str, holder: Any, box: Box) -> Any:
        """Add a ramp that rises along x from the floor of a box to its top."""
        (x0, y0, z0), (x1, y1, z1) = box
        corners = [(x, y, z) for x, z in ((x0, z0), (x1, z1), (x1, z0)) for y in (y0, y1)]
        faces = [(0, 2, 3, 1), (0, 1, 5, 4), (2, 4, 5, 3), (0, 4, 2), (1, 3, 5)]
        return self.faceted("IfcRamp", name, holder, corners, faces)

    def faceted(
        self,
        class_: str,
        name: str,
        holder: Any,
        corners: Sequence[Sequence[float]],
        faces: Sequence[Sequence[int]],
    ) -> Any:
        """Add a product of flat faces, each the numbers of its corners."""
        product = self.add(class_, name, holder)
        make = self.model.create_entity
        points = [
            make("IfcCartesianPoint", tuple((np.asarray(corner) * self.scale).tolist()))
            for corner in corners
        ]
        loops = [make("IfcPolyLoop", [points[int(i)] for i in face]) for face in faces]
        bounds = [make("IfcFaceOuterBound", loop, True) for loop in loops]
        shell = make("IfcClosedShell", [make("IfcFace", [bound]) for bound in bounds])
        self._shape(product, [make("IfcFacetedBrep", shell)], (0, 0, 0), 0.0)
        return product

    def bound(self, space: Any, element: Any) -> None:
        """State that an element is on the border of a space."""
        self._relate("IfcRelSpaceBoundary", RelatingSpace=space, RelatedBuildingElement=element)

    def opening(self, wall: Any, box: Box, filled_by: Any = None) -> None:
        """Cut an opening into a wall."""
        hole = root.create_entity(self.model, ifc_class="IfcOpeningElement", name="opening")
        self._shape(hole, [self._solid(np.asarray(box) - box[0])], box[0], 0.0)
        self._relate("IfcRelVoidsElement", RelatingBuildingElement=wall, RelatedOpeningElement=hole)
        if filled_by is not None:
            names = {"RelatingOpeningElement": hole, "RelatedBuildingElement": filled_by}
            self._relate("IfcRelFillsElement", **names)

    def _relate(self, class_: str, **names: Any) -> None:
        relation = root.create_entity(self.model, ifc_class=class_)
        for attribute, value in names.items():
            setattr(relation, attribute, value)

    def place_on_earth(self, epsg: int, easting: float, northing: float, turn: Sequence[float]):
        georeference.add_georeferencing(self.model)
        georeference.edit_georeferencing(
            self.model,
            projected_crs={"Name": f"EPSG:{epsg}"},
            coordinate_operation={
                "Eastings": easting,
                "Northings": northing,
                "XAxisAbscissa": turn[0],
                "XAxisOrdinate": turn[1],
            },
        )

    def write(self, path: Path) -> Path:
        self.model.write(str(path))
        return path

    def _shape(
        self, product: Any, items: Sequence[Any], origin: Sequence[float], yaw: float
    ) -> None:
        self._place(product, origin, yaw)
        shape = self.model.create_entity(
            "IfcShapeRepresentation", self.body, "Body", "SweptSolid", items
        )
        geometry.assign_representation(self.model, product=product, representation=shape)

    def _place(self, product: Any, at: Sequence[float], yaw: float) -> None:
        matrix = np.eye(4)
        matrix[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        matrix[:3, 3] = at
        geometry.edit_object_placement(self.model, product=product, matrix=matrix, is_si=True)

    def _solid(self, box: np.ndarray) -> Any:
        low, high = box * self.scale
        (x, y, z), (width, depth, height) = low.tolist(), (high - low).tolist()
        make = self.model.create_entity
        middle = make("IfcCartesianPoint", (x + width / 2, y + depth / 2))
        profile = make(
            "IfcRectangleProfileDef",
            "AREA",
            None,
            make("IfcAxis2Placement2D", middle),
            width,
            depth,
        )
        return self._extruded(profile, z, height)

    def _extruded(self, profile: Any, z: float, height: float) -> Any:
        make = self.model.create_entity
        base = make("IfcAxis2Placement3D", make("IfcCartesianPoint", (0.0, 0.0, z)))
        up = make("IfcDirection", (0.0, 0.0, 1.0))
        return make("IfcExtrudedAreaSolid", profile, base, up, height)
