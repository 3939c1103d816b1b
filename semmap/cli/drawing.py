"""`semmap draw`: floor plans and views of a map as pictures."""

from __future__ import annotations

from pathlib import Path

from typer import Option

from semmap.cli.operation_command import MethodCall, command_of


@command_of("Map.draw", walls="--walls/--no-walls")
def draw_command(
    call: MethodCall,
    output: Path = Option(Path("map.png"), "-o", help="The file: .png, .svg or .pdf."),
    solid: bool = Option(False, "--3d", help="All storeys in 3D instead."),
) -> None:
    """Draw the floor plan of a storey, those of all one below another, or the map in 3D."""
    if solid:
        given = {key: call.values[key] for key in ("title", "assume_sizes") if key in call.values}
        picture = call.handle.draw_3d(**given)
    else:
        picture = call()
    print(picture.save(output))
