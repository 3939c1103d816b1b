"""The viewer in a real browser: it shows the small house, hears of changes, and finds its way."""

from __future__ import annotations

import base64
import io
import math
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from playwright.sync_api import Page
from scipy.spatial import cKDTree
from sqlalchemy import Engine

import semmap
from planner.readers.robot_class import store_robot_class
from planner.robot_class import RobotClass
from semmap.robot import Part
from tests.browser import SIZE, open_viewer, until
from tests.served import served


@pytest.fixture(scope="module")
def db(house: Engine) -> Iterator[semmap.Database]:
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        yield db


SQUARE = 0.2 * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
TOKEN = "a-token-of-an-admin"


@pytest.fixture(scope="module")
def url(db: semmap.Database) -> Iterator[str]:
    with served(db, {TOKEN: "semmap_admin"}) as address:
        yield address


@pytest.fixture
def page(browser: Any, url: str) -> Iterator[Page]:
    """The page, when it has shown the map; it asks nobody else, and raises nothing."""
    page = browser.new_page(viewport=SIZE)
    asked: list[str] = []
    raised: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: raised.append(str(error)))
    open_viewer(page, f"{url}/view/?map=house")
    yield page
    page.close()
    assert [each for each in asked if not each.startswith((url, "data:", f"blob:{url}"))] == []
    assert raised == []


def known(page: Page, name: str, key: str) -> Any:
    return page.evaluate("([name, key]) => semmap.house.entities.get(name)?.[key]", [name, key])


def test_it_has_what_the_map_has(page: Page, db: semmap.Database) -> None:
    house = db.map("house")
    told = dict(page.evaluate("[...semmap.house.entities].map(([name, e]) => [name, e.pose])"))
    there = {e.name: e.pose for e in house.find() if e.kind not in ("storey", "elevator")}
    assert told.keys() == there.keys()
    for entity in house.find("object"):
        assert told[entity.name] == pytest.approx(list(entity.pose))


def test_what_is_met_first_is_what_rays_meet_first(page: Page, db: semmap.Database) -> None:
    """Rays are cast here through the meshes of the map by another algorithm, in double numbers."""
    for kind in ("rooms", "doors"):
        page.get_by_label(kind, exact=True).uncheck()
    meshes = [(e.name, e.mesh) for e in db.map("house").find("object") if e.mesh is not None]
    meshes = [(name, mesh) for name, mesh in meshes if known(page, name, "overhead") is False]
    owner = np.repeat([name for name, _ in meshes], [len(mesh.faces) for _, mesh in meshes])
    triangles = np.concatenate([mesh.triangles for _, mesh in meshes])
    dice = np.random.default_rng(5)
    agreed = 0
    for x, y in dice.uniform((330, 100), (880, 500), (40, 2)):
        seen, origin, way = page.evaluate(
            "([clientX, clientY]) => { const ray = semmap.stage.ray({clientX, clientY});"
            "return [semmap.house.met(ray) ?? null, ...[ray.ray.origin, ray.ray.direction]"
            ".map((v) => v.toArray())] }",
            [x, y],
        )
        distances = along(triangles, np.array(origin), np.array(way))
        first = distances.argmin()
        if seen is None:
            assert distances[first] == np.inf
        else:
            own = distances[owner == seen].min()
            assert own == pytest.approx(distances[first], abs=2e-3), (seen, owner[first])
            agreed += 1
    assert agreed > 20


def along(triangles: np.ndarray, origin: np.ndarray, way: np.ndarray) -> np.ndarray:
    """How far a ray goes to each triangle; infinite past them (plane, then signs of areas)."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = ((a - origin) * normal).sum(1) / (normal @ way)
        point = origin + far[:, None] * way
        sides = [(np.cross(q - p, point - p) * normal).sum(1) for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all(np.array(sides) >= 0, axis=0) & (far > 0)
    return np.where(inside, far, np.inf)


def test_changes_of_others_appear(page: Page, db: semmap.Database) -> None:
    house = db.map("house")
    ball = house["Ball_01_001"]
    ball.move_to(1.25, -2.5, 0.5)
    until(page, "semmap.house.entities.get('Ball_01_001').pose[0] === 1.25")
    at = page.evaluate(
        "(() => { const { object, number } = semmap.house.entities.get('Ball_01_001');"
        "return [...object.instanceMatrix.array.slice(16 * number + 12, 16 * number + 15)] })()"
    )
    assert at == pytest.approx([1.25, -2.5, 0.5])
    door = next(iter(house.doors))
    before = page.evaluate(
        "(name) => semmap.house.entities.get(name).object.material.color.getHex()", door.name
    )
    door.state = "closed" if door.state == "open" else "open"
    until(
        page,
        "([name, before]) => semmap.house.entities.get(name).object.material.color.getHex() "
        "!== before",
        [door.name, before],
    )
    house.add_object("Stuhl <b>1</b>", type="chair", size=(0.4, 0.4, 0.9), pose=(1, -1, 0))
    until(page, "semmap.house.entities.has('Stuhl <b>1</b>')")
    assert page.locator("#note").inner_text() == ""
    house.add_object("aroma", type="chair", in_="kitchen")
    until(page, "document.getElementById('note').innerText.startsWith('1 things have no shape')")
    house["aroma"].delete()
    page.get_by_placeholder("Search").fill("chair <b>")
    page.get_by_role("button", name="Stuhl <b>1</b> chair").click()
    page.get_by_role("heading", name="Stuhl <b>1</b>").wait_for(timeout=5000)
    house["Stuhl <b>1</b>"].delete()
    until(page, "semmap.house.entities.get('Stuhl <b>1</b>').removed")


def test_routes_and_answers_are_marked(page: Page, db: semmap.Database) -> None:
    house = db.map("house")
    route = page.locator("#route")
    route.get_by_placeholder("from").fill("bedroom")
    route.get_by_placeholder("to", exact=True).fill("kitchen")
    route.get_by_role("button").click()
    until(page, "semmap.house.overlays.lines.children.length")
    metres = house.route("bedroom", "kitchen").metres
    assert route.locator("output").inner_text().startswith(f"{metres:.1f} m")
    route.get_by_placeholder("to", exact=True).fill("nowhere")
    route.get_by_role("button").click()
    until(page, "document.querySelector('#route output').className === 'wrong'")
    assert "nowhere" in route.locator("output").inner_text()
    query = page.locator("#query")
    query.get_by_role("textbox").fill("SELECT ?x { ?x a semmap:Chair }")
    query.get_by_role("button").click()
    until(page, "semmap.house.marked.size > 0")
    assert {*page.evaluate("[...semmap.house.marked.keys()]")} == {
        e.name for e in house.find("chair")
    }
    query.get_by_label("Language").select_option("sql")
    query.get_by_role("textbox").fill("SELECT name FROM entry WHERE type = 'ball'")
    query.get_by_role("button").click()
    balls = {e.name for e in house.find("ball")}
    until(page, f"semmap.house.marked.size === {len(balls)}")
    assert {*page.evaluate("[...semmap.house.marked.keys()]")} == balls
    where = page.locator("#where")
    where.get_by_placeholder("a name").fill("Ball_01_001")
    where.get_by_role("button").click()
    until(page, "document.querySelector('#where output').innerText.includes('%')")
    believed = house.where("Ball_01_001")
    for name, share in page.evaluate("[...semmap.house.marked]"):
        assert share**2 == pytest.approx(believed[name], abs=0.01)


def test_costs_lie_on_the_floor_and_follow_changes(page: Page, db: semmap.Database) -> None:
    """The picture has colour exactly where the grid has an occupied cell."""
    house = db.map("house")
    costs = page.locator("#costs")
    costs.get_by_role("button").click()
    until(page, "semmap.house.overlays.costs.children.length === 1")
    assert costs.locator("output").inner_text().startswith(house.grid().scene.storey)
    same_cells(page, house)
    chair = house.find("chair")[0]
    chair.move_to(0, -1, 0.0)
    before = page.evaluate("semmap.house.overlays.costs.children[0].uuid")
    until(page, "(uuid) => semmap.house.overlays.costs.children[0].uuid !== uuid", before)
    same_cells(page, house)
    costs.get_by_role("textbox").fill("nobody")
    costs.get_by_role("button").click()
    until(page, "document.querySelector('#costs output').className === 'wrong'")


def test_costs_of_parts_lie_at_their_heights(page: Page, house: Engine) -> None:
    base = Part("base", ("base",), (0.0, 0.4), SQUARE, 0.2, 0.29)
    arm = Part("arm", ("arm",), (0.9, 1.3), 0.5 * SQUARE, 0.1, 0.15)
    with house.begin() as connection:
        store_robot_class(connection, RobotClass("tall", (base, arm)))
    costs = page.locator("#costs")
    costs.get_by_role("textbox").fill("tall")
    costs.get_by_label("each part at its height").check()
    costs.get_by_role("button").click()
    until(page, "semmap.house.overlays.costs.children.length === 2", seconds=60)
    heights = page.evaluate("semmap.house.overlays.costs.children.map((c) => c.position.z)")
    assert sorted(heights) == pytest.approx([0.2, 1.1])
    assert "base" in costs.locator("output").inner_text()


def same_cells(page: Page, house: semmap.Map) -> None:
    made = house.grid()
    there = page.evaluate(
        "(() => { const plane = semmap.house.overlays.costs.children[0];"
        "const { image } = plane.material.map; const { width, height } = image;"
        "const paper = new OffscreenCanvas(width, height).getContext('2d');"
        "paper.drawImage(image, 0, 0);"
        "const { data } = paper.getImageData(0, 0, width, height);"
        "const size = plane.geometry.parameters;"
        "return { width, height, middle: plane.position.toArray(), size: [size.width, size.height],"
        "alpha: [...data].filter((_, i) => i % 4 === 3) } })()"
    )
    rows, columns = made.grid.shape
    assert (there["height"], there["width"]) == (rows, columns)
    assert np.array_equal(np.reshape(there["alpha"], (rows, columns)) > 0, made.cells == 100)
    wide = np.array([columns, rows]) * made.grid.resolution
    assert there["size"] == pytest.approx(wide)
    assert there["middle"][:2] == pytest.approx(np.array(made.grid.origin) + wide / 2)


def test_voxels_of_fields_are_drawn(page: Page, db: semmap.Database) -> None:
    """A cube is drawn at each point of the chairs' surfaces, to a voxel, and none beside them."""
    house = db.map("house")
    query = page.locator("#query")
    query.get_by_label("Language").select_option("fields")
    query.get_by_role("textbox").fill(
        "PREFIX : <urn:semmap:ontology#> SELECT ?v ?e { ?v :occupiedBy ?e . ?e a :Chair }"
    )
    query.get_by_role("button").click()
    until(page, "semmap.house.overlays.voxels.children.length > 0", seconds=60)
    drawn = page.evaluate(
        "semmap.house.overlays.voxels.children.map((mesh) => [mesh.name, [...Array(mesh.count)]"
        ".map((_, i) => [...mesh.instanceMatrix.array.slice(16 * i + 12, 16 * i + 15)])])"
    )
    chairs = {e.name: e.mesh for e in house.find("chair")}
    assert {name for name, _ in drawn} == chairs.keys()
    assert {*page.evaluate("[...semmap.house.marked.keys()]")} == chairs.keys()
    size = house.fields.voxel_size
    for name, centres in drawn:
        mesh = chairs[name]
        points = trimesh.sample.sample_surface(mesh, 5000, seed=3)[0]
        away = cKDTree(centres).query(points)[0]
        assert (away <= size * math.sqrt(3)).all()  # the diagonal of a voxel
        low, high = mesh.bounds
        assert (np.array(centres) > low - size).all()
        assert (np.array(centres) < high + size).all()


def test_missions_are_listed_with_their_steps(page: Page, db: semmap.Database) -> None:
    db.map("house").run("in(robot, kitchen)", start="bedroom", simulate=True, speed=1000)
    until(page, "document.querySelector('#missions li') !== null", seconds=30)
    item = page.locator("#missions li").first
    assert "in(robot, kitchen) (simulated)" in item.inner_text()
    assert "done, " in item.inner_text()
    item.get_by_role("button").click()
    until(page, "document.querySelectorAll('#missions ol li').length > 0")
    assert page.locator("#missions ol li").last.get_attribute("class") == "done"
    assert "kitchen" in page.evaluate("[...semmap.house.marked.keys()]")


def test_the_past_shows_where_things_were(page: Page, db: semmap.Database) -> None:
    house = db.map("house")
    ball = house["Ball_01_001"]
    ball.move_to(2.0, -2.0, 0.5)
    ball.move_to(2.5, -1.5, 0.5)
    house.add_object("late", type="box", size=(0.2, 0.2, 0.2), pose=(1, -1, 0))
    until(page, "semmap.house.entities.has('late')")

    def go_back(steps: int) -> None:
        page.evaluate(
            "(steps) => { const slider = document.getElementById('moment');"
            "slider.value = slider.max - steps; slider.dispatchEvent(new Event('input')) }",
            steps,
        )

    def drawn(name: str) -> list[float]:
        return page.evaluate(
            "(name) => { const { object, number } = semmap.house.entities.get(name);"
            "return [...object.instanceMatrix.array.slice(16 * number + 12, 16 * number + 15)] }",
            name,
        )

    now = drawn("Ball_01_001")
    assert now == pytest.approx([2.5, -1.5, 0.5])
    added = sum(event.name == "late" for event in house.changes())
    for steps, place in ((added, [2.5, -1.5, 0.5]), (added + 1, [2.0, -2.0, 0.5])):
        go_back(steps)
        until(page, "semmap.house.past !== null")
        until(
            page,
            "(x) => Math.abs(semmap.house.past['Ball_01_001'][0] - x) < 1e-6",
            place[0],
        )
        assert drawn("Ball_01_001") == pytest.approx(place)
        assert known(page, "late", "object") is not None
        assert page.evaluate("semmap.house.past['late']") is None
        assert drawn("late") == [0, 0, 0]
    ball.move_to(1.0, -1.0, 0.5)
    until(page, "semmap.house.entities.get('Ball_01_001').pose[0] === 1")
    assert drawn("Ball_01_001") == pytest.approx([2.0, -2.0, 0.5])
    go_back(0)
    until(page, "semmap.house.past === null")
    assert drawn("Ball_01_001") == pytest.approx([1.0, -1.0, 0.5])
    house["late"].delete()


def test_a_link_restores_the_view(page: Page, browser: Any) -> None:
    page.get_by_label("things", exact=True).uncheck()
    page.get_by_placeholder("Search").fill("sofa")
    page.get_by_role("button", name="Sofa").first.click()
    until(page, "location.hash.includes('selected')")
    state = (
        "[semmap.stage.camera.position.toArray().map((v) => Math.round(10 * v)), "
        "[...semmap.house.marked.keys()], [...semmap.house.hidden].sort()]"
    )
    before = page.evaluate(state)
    again = browser.new_page(viewport=SIZE)
    open_viewer(again, page.url)
    assert again.evaluate(state) == before
    assert before[1]
    again.close()


def test_without_a_name_the_only_map_is_shown(browser: Any, url: str, db: semmap.Database) -> None:
    page = browser.new_page(viewport=SIZE)
    open_viewer(page, f"{url}/view/")
    assert page.evaluate("semmap.house.entities.size") > 0
    db.create_map("shed")
    try:
        page.reload()
        until(page, "document.body.innerText.includes('add ?map=NAME to the address: house, shed')")
    finally:
        db.drop_map("shed")
        page.close()


def test_the_page_loads_nothing_from_elsewhere(page: Page) -> None:
    refused = page.evaluate(
        "fetch('http://127.0.0.2:9/').then(() => 'sent', (error) => error.message)"
    )
    assert refused != "sent"
    reply = page.request.get(page.url)
    assert "default-src 'self'" in reply.headers["content-security-policy"]


@pytest.fixture
def writer(browser: Any, url: str) -> Iterator[Page]:
    """The page of somebody who may change the map."""
    page = browser.new_page(viewport=SIZE)
    open_viewer(page, f"{url}/view/?map=house#token={TOKEN}")
    assert TOKEN not in page.url
    yield page
    page.close()


def choose(page: Page, name: str) -> None:
    page.get_by_placeholder("Search").fill(name)
    page.get_by_role("button", name=name).first.click()
    page.get_by_role("heading", name=name, exact=True).wait_for(timeout=5000)


def test_what_is_dragged_is_moved_and_moved_back(writer: Page, db: semmap.Database) -> None:
    ball = db.map("house")["Ball_01_001"]
    before = ball.pose
    choose(writer, ball.name)
    # The arrow is found by the pointer, along the axis x in the picture.
    points = writer.evaluate(
        "[0, 1].map((far) => { const { hand, stage } = semmap;"
        "const { left, top, width, height } = stage.canvas.getBoundingClientRect();"
        "const at = hand.point.position.clone(); at.x += far; at.project(stage.camera);"
        "return [left + (at.x + 1) / 2 * width, top + (1 - at.y) / 2 * height] })"
    )
    (x0, y0), (x1, y1) = points
    way = np.array([x1 - x0, y1 - y0])
    way /= np.linalg.norm(way)
    for far in range(8, 200, 4):
        writer.mouse.move(x0 + far * way[0], y0 + far * way[1])
        if writer.evaluate("semmap.hand.gizmo.axis") == "X":
            break
    else:
        raise AssertionError("no arrow")
    writer.mouse.down()
    writer.mouse.move(x0 + (far + 60) * way[0], y0 + (far + 60) * way[1], steps=4)
    writer.mouse.up()
    until(writer, "document.getElementById('status').value === 'move to: done'")
    assert ball.pose.x > before.x + 0.05
    assert (ball.pose.y, ball.pose.z) == pytest.approx((before.y, before.z), abs=1e-6)
    writer.keyboard.press("Control+z")
    until(writer, "document.getElementById('status').value === 'taken back'")
    assert ball.pose[:3] == pytest.approx(before[:3], abs=1e-6)


def choose_door(writer: Page, db: semmap.Database) -> tuple[semmap.Door, str, Any]:
    """A door whose card is shown, its state, and the field for another one."""
    door = next(iter(db.map("house").doors))
    choose(writer, door.name)
    return door, door.state, writer.get_by_label("new state")


def test_a_name_and_a_state_are_changed_in_the_card(writer: Page, db: semmap.Database) -> None:
    door, former, field = choose_door(writer, db)
    field.fill("ajar")
    field.press("Enter")
    until(writer, "document.getElementById('status').value.includes('ajar')")
    assert door.state == former
    choose(writer, door.name)
    field.fill("locked")
    field.press("Enter")
    until(writer, "document.getElementById('status').value === 'set state: done'")
    assert door.state == "locked"
    door.state = former


@pytest.mark.parametrize("whose", ["own", "of others"])
def test_what_was_renamed_can_be_changed_on(writer: Page, db: semmap.Database, whose: str) -> None:
    house = db.map("house")
    crate = house.add_object("crate9", type="box", size=(0.4, 0.4, 0.4), pose=(1, 1, 0))
    until(writer, "semmap.house.entities.has('crate9')")
    choose(writer, "crate9")
    if whose == "own":
        writer.get_by_label("new name").fill("kiste")
        writer.get_by_label("new name").press("Enter")
    else:
        crate.name = "kiste"
    writer.get_by_role("heading", name="kiste", exact=True).wait_for(timeout=5000)
    until(writer, "location.hash.includes('selected=kiste')")
    writer.get_by_label("new type").fill("bottle")
    writer.get_by_label("new type").press("Enter")
    until(writer, "document.getElementById('status').value === 'set type: done'")
    assert house["kiste"].type == "bottle"
    house["kiste"].delete()


def test_what_others_changed_since_is_not_taken_back(writer: Page, db: semmap.Database) -> None:
    house = db.map("house")
    crate = house.add_object("crate9", type="box", size=(0.4, 0.4, 0.4), pose=(1, 1, 0))
    until(writer, "semmap.house.entities.has('crate9')")
    choose(writer, "crate9")
    writer.get_by_label("new type").fill("bottle")
    writer.get_by_label("new type").press("Enter")
    until(writer, "document.getElementById('status').value === 'set type: done'")
    crate.type = "can"
    until(writer, "semmap.house.entities.get('crate9').type === 'can'")
    writer.keyboard.press("Escape")
    writer.keyboard.press("Control+z")
    until(writer, "document.getElementById('status').value.includes('changed since')")
    assert crate.type == "can"
    crate.delete()


def test_where_something_has_been_is_in_its_card(page: Page, db: semmap.Database) -> None:
    house = db.map("house")
    cup, table = choose_on_table(page, house, "cup", (0.07, 0.07, 0.1))
    cup.move_to(1.25, 1.0, 0.0)
    until(page, "document.querySelector('#card dl').textContent.includes('1.25')")
    page.get_by_role("button", name="Where it has been").click()
    until(
        page, "[...document.querySelectorAll('#card output')].some((o) => o.value.includes('1.25'))"
    )
    lines = page.locator("#card output").last.inner_text().splitlines()
    assert "(1.25, 1.00, 0.00)" in lines[0]
    assert f"{table.name} (" in lines[1]
    assert len(lines) == len(cup.history())
    cup.delete()


def test_a_shown_route_follows_changes(page: Page, db: semmap.Database) -> None:
    """A door on its way is locked, and there is no way any more; and again."""
    house = db.map("house")
    door = next(iter(house.doors))
    former, (one, two) = door.state, [place.name for place in door.places]
    form, output = page.locator("#route"), page.locator("#route output")
    form.get_by_placeholder("from").fill(one)
    form.get_by_placeholder("to").fill(two)
    form.get_by_role("button").click()
    until(page, "/ m, .*s/.test(document.querySelector('#route output').value)", seconds=60)
    shown = output.inner_text()
    assert door.name in shown
    door.state = "locked"
    until(page, f"document.querySelector('#route output').value !== {shown!r}", seconds=60)
    with pytest.raises(ValueError, match="no route") as refused:
        house.route(one, two)
    assert output.inner_text() == str(refused.value)
    door.state = former
    until(page, f"document.querySelector('#route output').value === {shown!r}", seconds=60)


def test_a_change_of_the_map_keeps_what_is_being_typed(writer: Page, db: semmap.Database) -> None:
    door, former, field = choose_door(writer, db)
    field.fill("lock")
    door.state = "closed"
    until(writer, f"semmap.house.entities.get({door.name!r}).state === 'closed'")
    writer.wait_for_timeout(1000)  # the card would be read again
    assert field.input_value() == "lock"
    field.press_sequentially("ed")
    field.press("Enter")
    until(writer, "document.getElementById('status').value === 'set state: done'")
    assert door.state == "locked"
    until(writer, "document.querySelector('#card dl').textContent.includes('locked')")
    door.state = former


def test_properties_are_in_the_card_and_addresses_are_links(
    page: Page, db: semmap.Database
) -> None:
    house = db.map("house")
    file, odd = "https://example.org/crate.step", "javascript:alert(1)"
    crate = house.add_object(
        "crate7",
        type="box",
        size=(0.4, 0.4, 0.4),
        pose=(0, 0, 0, 0),
        properties={"cad": file, "x": odd},
    )
    until(page, "semmap.house.entities.has('crate7')")
    choose(page, "crate7")
    page.get_by_text("properties", exact=True).click()
    assert page.get_by_role("link", name=file).get_attribute("href") == file
    assert page.get_by_text(odd).count() == 1
    assert page.get_by_role("link", name=odd).count() == 0
    crate.delete()


def test_photos_of_what_is_selected_are_in_its_card(page: Page, db: semmap.Database) -> None:
    """They are stored in the map: what is on another host is a text, and not loaded."""
    house = db.map("house")
    crate = house.add_object("crate8", size=(0.4, 0.4, 0.4), pose=(1, 1, 0))
    photos = []
    for wide in (7, 5):
        file = io.BytesIO()
        Image.new("RGB", (wide, 3), "red").save(file, "PNG")
        photos.append("data:image/png;base64," + base64.b64encode(file.getvalue()).decode())
    elsewhere = "https://example.org/crate.jpg"
    crate.properties |= {"photo": photos[0], "more": [photos[1], elsewhere], "url": elsewhere}
    until(page, "semmap.house.entities.has('crate8')")
    choose(page, "crate8")
    shown = page.get_by_role("img", name="a picture of crate8")
    shown.first.wait_for(timeout=5000)
    sizes = shown.evaluate_all("all => all.map((each) => [each.naturalWidth, each.naturalHeight])")
    assert sorted(sizes) == [[5, 3], [7, 3]]
    page.get_by_text("properties", exact=True).click()
    assert page.get_by_role("link", name=elsewhere).count() == 2
    assert page.evaluate("document.querySelector('#card').textContent.includes('base64')") is False
    crate.delete()


def choose_on_table(
    page: Page, house: semmap.Map, type_: str, size: tuple[float, float, float]
) -> tuple[semmap.MapEntity, semmap.MapEntity]:
    """A new thing whose card is shown, and the table on which it is put."""
    table = house.find("table")[0]
    thing = house.add_object(f"{type_}77", type=type_, size=size, on=table.name)
    until(page, f"semmap.house.entities.has({thing.name!r})")
    choose(page, thing.name)
    return thing, table


def test_the_belief_of_what_is_selected_is_in_its_card(page: Page, db: semmap.Database) -> None:
    house = db.map("house")
    cup, table = choose_on_table(page, house, "cup", (0.07, 0.07, 0.1))
    page.get_by_role("button", name="Where it probably is").click()
    until(page, "document.querySelector('#card output:not(:empty)')?.value.includes('%')")
    likely = max(house.where(cup.name).items(), key=lambda place: place[1])
    assert likely[0] == table.name
    told = page.evaluate("document.querySelector('#card').innerText")
    assert f"{likely[0]} {round(100 * likely[1])} %" in told
    cup.delete()


def test_grasps_of_what_is_selected_are_drawn(writer: Page, db: semmap.Database) -> None:
    """Each fork is at a distance from the can at which its fingers reach around it."""
    can, _ = choose_on_table(writer, db.map("house"), "can", (0.05, 0.05, 0.12))
    writer.get_by_role("button", name="Show grasps").click()
    until(writer, "semmap.house.overlays.grasps.children.length > 0", seconds=60)
    places = writer.evaluate(
        "semmap.house.overlays.grasps.children.map((fork) => fork.position.toArray())"
    )
    away = trimesh.proximity.ProximityQuery(can.mesh).on_surface(places)[1]
    assert (away < 0.08).all()
    can.delete()


@contextmanager
def viewing(db: semmap.Database, port: int) -> Iterator[subprocess.Popen[bytes]]:
    """`semmap view` as a process of its own, until the end of the block."""
    program = str(Path(sys.executable).with_name("semmap"))
    words = [program, "view", "--map", "house", "--no-browser"]
    environment = os.environ | {"SEMMAP_DB": str(db.address)}
    process = subprocess.Popen(
        [*words, "--port", str(port)], env=environment, stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    try:
        assert b"/view/" in process.stdout.readline()
        yield process
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()


def test_a_page_goes_on_when_its_server_was_killed(browser: Any, db: semmap.Database) -> None:
    """What moves while there is no server is seen by the page when there is one again."""
    house = db.map("house")
    ball = house["Ball_01_001"]
    x, y, z = ball.pose[:3]
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    page = browser.new_page(viewport=SIZE)
    pose = "Math.abs(semmap.house.entities.get('Ball_01_001').pose[0] - {}) < 1e-6"
    try:
        with viewing(db, port) as process:
            open_viewer(page, f"http://127.0.0.1:{port}/view/?map=house")
            until(page, pose.format(x))
            process.kill()
            process.wait(20)
        until(page, "document.getElementById('status').value.startsWith('away')")
        ball.move_to(x + 0.5, y, z)
        with viewing(db, port):
            until(page, pose.format(x + 0.5), seconds=20)
            until(page, "document.getElementById('status').value === 'live'")
    finally:
        ball.move_to(x, y, z)
        page.close()
