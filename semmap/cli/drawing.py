"""`semmap draw`: floor plans and views of a map as pictures."""

from __future__ import annotations

from pathlib import Path

from typer import BadParameter, Option

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of


@command_of("Map.draw", start="--from", walls="--walls/--no-walls")
def draw_command(
    call: MethodCall,
    output: Path = Option(Path("map.png"), "-o", help="The file: .png, .svg or .pdf."),
    solid: bool = Option(False, "--3d", help="All storeys in 3D instead."),
) -> None:
    """Draw a floor plan, the map in 3D, or an answer: a route, belief, search, costs, voxels.

    semmap draw --route mug1 --from bedroom -o way.svg; semmap draw --belief mug
    """
    if solid:
        others = [key for key in call.values if key not in ("title", "assume_sizes")]
        others = [key for key in others if key != "walls" or not call.values["walls"]]
        if others:
            raise BadParameter(f"--3d draws all of the map: leave out --{others[0]}")
        given = {key: call.values[key] for key in ("title", "assume_sizes") if key in call.values}
        picture = call.handle.draw_3d(**given)
    else:
        picture = call()
    for note in picture.notes:
        cli.err.print(note, style="yellow")
    print(picture.save(output))
