"""A map as a QGIS project: its layers with symbols, labels and forms, one group a storey."""
