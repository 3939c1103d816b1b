"""Pictures of the map: floor plans and rooms in 3D. Arrays and plain dataclasses, no database."""
