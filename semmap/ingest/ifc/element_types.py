"""The semantic types that the classes of IFC mean, where the class alone tells."""

from __future__ import annotations

from typing import Any

from semmap.ingest.naming import give_type
from semmap.ingest.world import Entry

TYPES = {
    "IfcWall": "wall",
    "IfcCurtainWall": "wall",
    "IfcPlate": "wall",
    "IfcDoor": "door_leaf",
    "IfcWindow": "window",
    "IfcColumn": "column",
    "IfcBeam": "beam",
    "IfcMember": "beam",
    "IfcRailing": "railing",
    "IfcRoof": "roof",
    "IfcSlab ROOF": "roof",
    "IfcSlab": "floor",
    "IfcCovering CEILING": "ceiling",
    "IfcCovering FLOORING": "floor",
    "IfcFooting": "building_element",
    "IfcPile": "building_element",
    "IfcStair": "stair_flight",
    "IfcStairFlight": "stair_flight",
    "IfcRamp": "ramp_flight",
    "IfcRampFlight": "ramp_flight",
    "IfcFurniture BED": "bed",
    "IfcFurniture CHAIR": "chair",
    "IfcFurniture DESK": "desk",
    "IfcFurniture FILECABINET": "filing_cabinet",
    "IfcFurniture SHELF": "shelf",
    "IfcFurniture SOFA": "sofa",
    "IfcFurniture TABLE": "table",
    "IfcSanitaryTerminal BATH": "bathtub",
    "IfcSanitaryTerminal SHOWER": "shower",
    "IfcSanitaryTerminal SINK": "sink",
    "IfcSanitaryTerminal TOILETPAN": "toilet",
    "IfcSanitaryTerminal URINAL": "urinal",
    "IfcSanitaryTerminal WASHHANDBASIN": "sink",
    "IfcElectricAppliance DISHWASHER": "dishwasher",
    "IfcElectricAppliance ELECTRICCOOKER": "stove",
    "IfcElectricAppliance FREEZER": "refrigerator",
    "IfcElectricAppliance FRIDGE_FREEZER": "refrigerator",
    "IfcElectricAppliance MICROWAVE": "microwave",
    "IfcElectricAppliance REFRIGERATOR": "refrigerator",
    "IfcElectricAppliance TUMBLEDRYER": "dryer",
    "IfcElectricAppliance VENDINGMACHINE": "vending_machine",
    "IfcElectricAppliance WASHINGMACHINE": "washing_machine",
    "IfcLightFixture": "lamp",
    "IfcSpaceHeater": "radiator",
}
"""By class, or class and predefined type, of which the first counts; a subclass means the same."""

KINDS = {
    "IfcBuildingElement": "building_element",
    "IfcBuiltElement": "building_element",
    "IfcFurnishingElement": "furniture",
}
"""Classes whose elements may have a type that their name says, else this."""


def family(element: Any) -> str:
    """Return the part of an element's name that says what it is.

    Revit writes `family:type:number`.

    >>> from types import SimpleNamespace
    >>> family(SimpleNamespace(Name="M_Chair-Breuer:M_Chair-Breuer:157"))
    'M_Chair-Breuer'
    """
    return str(element.Name or "").partition(":")[0].strip()


def give_element_type(entry: Entry, element: Any) -> None:
    """Give an entry the type that its element's class means, else that its name suggests.

    In a name such as `Tall Cabinet-Single Door` the part before the hyphen is tried first.
    """
    predefined = getattr(element, "PredefinedType", None)
    for means, type_ in TYPES.items():
        class_, _, kind = means.partition(" ")
        if element.is_a(class_) and kind in ("", predefined):
            entry.type = type_
            return
    own = family(element)
    give_type(entry, (own.partition("-")[0], own, str(getattr(element, "ObjectType", None) or "")))
    if entry.type is None:
        entry.type = next((type_ for class_, type_ in KINDS.items() if element.is_a(class_)), None)
