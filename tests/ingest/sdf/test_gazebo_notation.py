"""SDF files as Gazebo reads them: lax XML, old notation, nested includes, masses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semmap.geometry.pose import Pose
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import WorldError
from tests.ingest.sdf.worlds_by_hand import (
    BOX,
    LINK,
    MESH,
    at,
    entry,
    model_file,
    read,
    surface,
)

# What Gazebo loads


LOADED = {
    "dashes in a comment": "<sdf version='1.9'><!-- a -- b --->{}</sdf>",
    "comment before the declaration": "<!----><?xml version='1.0'?><sdf version='1.9'>{}</sdf>",
    "blank before the declaration": "\n <?xml version='1.0'?>\n<sdf version='1.9'>{}</sdf>",
    "undeclared prefix": "<sdf version='1.9'>{}<gz:dynamic_detachable gz:kind='x'/></sdf>",
    "lone ampersand": "<sdf version='1.9'>{}<author>A & B</author></sdf>",
    "obsolete root": "<gazebo version='1.2'>{}</gazebo>",
    "byte order mark": "\ufeff<!-- -- --><sdf version='1.9'>{}</sdf>",
}


@pytest.mark.parametrize("case", LOADED)
def test_what_gazebo_loads_is_read(tmp_path: Path, case: str) -> None:
    """TinyXML2 reads all of these; strict XML allows none of them."""
    path = tmp_path / "lax.world"
    path.write_text(LOADED[case].format(f"<world name='w'>{at('1 2 3 0 0 0')}</world>"))
    world = read_sdf(path)
    assert entry(world, "m").pose == Pose(1, 2, 3)
    assert len(entry(world, "m").shapes) == 1
    assert world.skipped == []


def test_errors_of_lax_files_name_the_line_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "lax.world"
    path.write_text("<!-- a\n -- b -->\n<?xml version='1.0'?>\n<sdf>\n<world></wrong></sdf>")
    with pytest.raises(WorldError, match=r"lax\.world: line 5"):
        read_sdf(path)


def test_the_notation_of_the_obsolete_root(tmp_path: Path) -> None:
    """SDF 1.0 has attributes for elements of today: unread, all models stand at the origin."""
    path = tmp_path / "old.world"
    path.write_text(
        """<gazebo version="1.0"><world name="w"><model name="crate" static="true">
        <origin pose="1 2 3 0 0 0"/><link name="l"><visual name="v"><origin pose="0 0 1 0 0 0"/>
        <geometry><box size="1 2 4"/></geometry></visual></link></model></world></gazebo>"""
    )
    world = read_sdf(path)
    assert world.skipped == []
    assert entry(world, "crate").properties["static"] is True
    np.testing.assert_allclose(surface(world, "crate").bounds, [(0.5, 1, 2), (1.5, 3, 6)])


def test_a_wrapped_include_has_its_place_and_shares_its_mesh(tmp_path: Path) -> None:
    """`<model><include><pose/></include></model>`, as Gazebo's editor nests what it groups."""
    model_file(tmp_path, "desk", LINK)
    wrapped = "".join(
        f"""<model name="desk_{n}"><static>true</static><pose>0 0 {n} 0 0 0</pose>
        <include><uri>model://desk</uri><pose>{n} 2 0 0 0 1.5707963267948966</pose></include>
        </model>"""
        for n in range(20)
    )
    world = read(tmp_path, wrapped)
    assert [e.name for e in world.entries] == [f"desk_{n}" for n in range(20)]
    for n, e in enumerate(world.entries):
        assert e.pose is not None
        np.testing.assert_allclose((e.pose.x, e.pose.y, e.pose.z, e.pose.yaw), (n, 2, n, np.pi / 2))
        assert (e.type, e.properties["model"], e.properties["static"]) == ("desk", "desk", True)
        np.testing.assert_allclose(surface(world, e.name).bounds.mean(axis=0), (n, 2, n), atol=1e-9)
    assert len({id(e.shapes[0].mesh) for e in world.entries}) == 1


def test_a_wrapped_include_without_its_mesh_keeps_its_place(tmp_path: Path) -> None:
    model_file(tmp_path, "pump", LINK.replace(BOX.format("1 2 3"), MESH.format("no.dae")))
    inner = "<include><uri>model://{}</uri><pose>1 2 3 0 0 0</pose></include>"
    world = read(
        tmp_path,
        "".join(f"<model name='{m}_1'>{inner.format(m)}</model>" for m in ("pump", "nowhere")),
    )
    assert [(e.name, e.pose, e.shapes) for e in world.entries] == [
        ("pump_1", Pose(1, 2, 3), []),
        ("nowhere_1", Pose(1, 2, 3), []),
    ]
    assert len(world.skipped) == 2


def test_a_sun_is_not_an_object(tmp_path: Path) -> None:
    """Neither the one of Gazebo's library, which may be missing, nor one beside the world."""
    include = "<include><uri>model://{}</uri></include>"
    world = read(tmp_path, include.format("sun") + at("0 0 0 0 0 0"))
    assert ([e.name for e in world.entries], world.skipped) == (["m"], [])
    (tmp_path / "daylight").mkdir()
    (tmp_path / "daylight" / "model.sdf").write_text("<sdf version='1.9'><light name='l'/></sdf>")
    world = read(tmp_path, include.format("daylight") + at("0 0 0 0 0 0"))
    assert ([e.name for e in world.entries], world.skipped) == (["m"], [])


@pytest.mark.parametrize(
    ("stated", "mass"),
    [
        ("<inertial><mass>0.4</mass></inertial>", 0.4),
        ("", None),
        ("<inertial/>", None),
        ("<inertial><mass>nan</mass></inertial>", None),
    ],
)
def test_the_mass_that_links_state(tmp_path: Path, stated: str, mass: float | None) -> None:
    shape = "<visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual>"
    link = f"<link name='{{}}'>{stated}{shape}</link>"
    model = f"<model name='m'>{link.format('a')}<model name='n'>{link.format('b')}</model></model>"
    world = read(tmp_path, model)
    expected = None if mass is None else pytest.approx(2 * mass)
    assert entry(world, "m").properties.get("mass") == expected
    assert entry(world, "m").properties["static"] is False
