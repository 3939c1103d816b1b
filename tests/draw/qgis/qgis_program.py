"""A QGIS without a window, run by the system's Python: opens a project, draws it, makes edits.

Reads JSON from its input, ``{"project": PATH, "pictures": FOLDER, "edits": [...]}``, and writes
JSON: the layers with whether they are valid, the pictures, the errors of each edit, and the default
styles of layers that are opened alone.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

os.environ["QT_QPA_PLATFORM"] = "offscreen"

from qgis.core import (
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsFeature,
    QgsFeatureRequest,
    QgsGeometry,
    QgsLayerTreeGroup,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsPointXY,
    QgsProject,
    QgsValueRelationFieldFormatter,
    QgsVectorLayer,
    QgsVectorLayerUtils,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor


def describe(layer: QgsVectorLayer) -> dict[str, Any]:
    """What a test asks of a layer."""
    fields = layer.fields()
    widgets = {field.name(): field.editorWidgetSetup().type() for field in fields}
    choices = QgsValueRelationFieldFormatter.createCache(
        layer.editorWidgetSetup(fields.indexOf("type")).config()
    )
    return {
        "name": layer.name(),
        "valid": layer.isValid(),
        "features": layer.featureCount(),
        "crs": layer.crs().isValid(),
        "source": layer.source(),
        "widgets": widgets,
        "choices": [choice.value for choice in choices],
    }


def draw(project: QgsProject, group: QgsLayerTreeGroup, path: str) -> str:
    """Draw the layers of a group to a file."""
    settings = QgsMapSettings()
    layers = [each.layer() for each in group.findLayers()]
    settings.setLayers(layers)
    settings.setBackgroundColor(QColor(project.backgroundColor()))
    settings.setDestinationCrs(project.crs())
    rooms = next(each for each in layers if each.name() == "rooms")
    extent = rooms.extent() if rooms.featureCount() else settings.fullExtent()
    extent.scale(1.1)
    width = 1600
    settings.setOutputSize(QSize(width, max(200, int(width * extent.height() / extent.width()))))
    settings.setOutputDpi(150)
    settings.setExtent(extent)
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    assert not job.errors(), [each.message for each in job.errors()]
    job.renderedImage().save(path)
    return path


def find(project: QgsProject, group: str, title: str) -> QgsVectorLayer:
    """The layer of a title in a group."""
    tree = project.layerTreeRoot().findGroup(group)
    return next(each.layer() for each in tree.findLayers() if each.layer().name() == title)


def edit(project: QgsProject, wanted: dict[str, Any]) -> list[str]:
    """Make one edit through the provider; the errors of its commit."""
    layer = find(project, wanted["storey"], wanted["layer"])
    assert layer.startEditing()
    if "draw" in wanted:
        values = {layer.fields().indexOf(k): v for k, v in wanted["values"].items()}
        shape = QgsGeometry.fromWkt(wanted["draw"])
        assert layer.addFeature(QgsVectorLayerUtils.createFeature(layer, shape, values))
    else:
        name = wanted["name"].replace("'", "''")
        request = QgsFeatureRequest().setFilterExpression(f"\"name\" = '{name}'")
        (feature,) = list(layer.getFeatures(request))
        change(layer, feature, wanted)
    errors = [] if layer.commitChanges() else list(layer.commitErrors())
    if errors:
        layer.rollBack()
    layer.reload()
    return errors


def change(layer: QgsVectorLayer, feature: QgsFeature, wanted: dict[str, Any]) -> None:
    """Move, turn, retype or delete a feature, as the tools of QGIS do."""
    shape = QgsGeometry(feature.geometry())
    if "move" in wanted:
        shape.translate(*wanted["move"])
    if "turn" in wanted:  # degrees, clockwise
        shape.rotate(wanted["turn"], shape.centroid().asPoint())
    if "wkt" in wanted:
        shape = QgsGeometry.fromWkt(wanted["wkt"])
    if not shape.equals(feature.geometry()):
        assert layer.changeGeometry(feature.id(), shape)
    for key, value in wanted.get("values", {}).items():
        assert layer.changeAttributeValue(feature.id(), layer.fields().indexOf(key), value)
    if wanted.get("delete"):
        assert layer.deleteFeature(feature.id())


def default_style(source: str) -> tuple[str, bool]:
    """How a view looks that is opened alone: the kind of its renderer, and if it has labels."""
    layer = QgsVectorLayer(source, "alone", "postgres")
    assert layer.isValid(), source
    return layer.renderer().type(), layer.labelsEnabled()


def on_earth(project: QgsProject, point: tuple[float, float]) -> list[float]:
    """Longitude and latitude of a point of the map."""
    earth = QgsCoordinateReferenceSystem("EPSG:4326")
    found = QgsCoordinateTransform(project.crs(), earth, project).transform(QgsPointXY(*point))
    return [found.x(), found.y()]


def main(wanted: dict[str, Any]) -> dict[str, Any]:
    """Do what is wanted; say what came of it."""
    project = QgsProject.instance()
    assert project.read(wanted["project"]), project.error()
    layers = [describe(each) for each in project.mapLayers().values()]
    plan = project.layerTreeRoot().findGroups()[0]
    pictures = {}
    if "pictures" in wanted:
        for group in plan.findGroups():
            path = Path(wanted["pictures"]) / f"{group.name().replace('/', '_')}.png"
            pictures[group.name()] = draw(project, group, str(path))
    return {
        "title": project.title(),
        "crs": project.crs().isValid(),
        "on_earth": on_earth(project, (10.0, 5.0)) if project.crs().isValid() else None,
        "layers": layers,
        "pictures": pictures,
        "errors": [edit(project, each) for each in wanted.get("edits", [])],
        "styles": [default_style(source) for source in wanted.get("sources", [])],
    }


if __name__ == "__main__":
    application = QgsApplication([], False)
    application.initQgis()
    answer = main(json.load(sys.stdin))
    print(json.dumps(answer))
    QgsProject.instance().clear()
    application.exitQgis()
