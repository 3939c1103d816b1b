"""Maps as files of other programs: GIS layers, scenes, simulated worlds, indoor formats."""
