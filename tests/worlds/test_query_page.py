"""The query page in a real browser: what it shows is what the endpoint answers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
import shapely
from playwright.sync_api import Page, Request

import semmap
from semmap.knowledge.vocabulary import GEO, prefixes, short
from tests.browser import SIZE, until
from tests.question_page import questions
from tests.served import served

TOKEN = "a-token-of-an-admin"
HOUSE = questions("twenty_questions.md", "The small house")
OUTLINES = "What are the outlines of the rooms?"


@pytest.fixture(scope="module")
def url(db: semmap.Database) -> Iterator[str]:
    with served(db) as address:
        yield address


@contextmanager
def opened(browser: Any, address: str, **options: Any) -> Iterator[tuple[Page, list[Request]]]:
    """The page with its requests; it asks no other host, and has no error."""
    page = browser.new_page(viewport=SIZE, **options)
    asked: list[Request] = []
    wrong: list[str] = []
    page.on("request", lambda request: asked.append(request))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: said.type == "error" and wrong.append(said.text))
    page.goto(address)
    page.evaluate("semmap.ready")
    yield page, asked
    page.close()
    host = address.split("/query")[0] + "/"
    assert [each.url for each in asked if not each.url.startswith((host, "data:", "blob:"))] == []
    # Chromium itself writes that an answer is an error.
    assert [each for each in wrong if "Failed to load resource" not in each] == []


@pytest.fixture
def page(browser: Any, url: str) -> Iterator[Page]:
    with opened(browser, f"{url}/query?map=house") as (page, _):
        yield page


def answer(url: str, text: str) -> list[dict[str, dict[str, str]]]:
    reply = httpx.get(f"{url}/maps/house/rdf/sparql", params={"query": text}, timeout=60)
    bindings: list[dict[str, dict[str, str]]] = reply.json()["results"]["bindings"]
    return bindings


def ask(page: Page, text: str, view: str = "") -> None:
    """Run a query in a tab of its own, and wait until the answer is shown."""
    page.evaluate(
        "(value) => { const tab = semmap.yasgui.addTab(true, { yasqe: { value } });"
        "semmap.yasgui.selectTabId(tab.getId()); return tab.query().catch(() => {}) }",
        text,
    )
    until(page, "document.querySelector('.tabPanel.active .yasr_results').childElementCount > 0")
    if view:
        page.locator(f".tabPanel.active .select_{view}").click()


def cell(term: dict[str, str]) -> str:
    """A term as the table shows it."""
    known = prefixes("house")
    if term["type"] == "uri":
        return short(term["value"], known)
    kind = term.get("datatype")
    return f'"{term["value"]}"^^{short(kind, known)}' if kind else term["value"]


@pytest.mark.parametrize(
    "question",
    ["How many chairs are in each room?", "What hangs higher than 1.2 m?", OUTLINES],
)
def test_an_example_is_answered_as_by_the_endpoint(page: Page, url: str, question: str) -> None:
    page.get_by_label("Examples").select_option(label=question)
    rows = page.locator(".tabPanel.active .yasr_results tbody tr")
    rows.first.wait_for()
    shown = [[each.inner_text() for each in row.locator("td").all()][1:] for row in rows.all()]
    expected = answer(url, HOUSE[question]["sparql"])
    assert len(expected) > 1
    assert sorted(shown) == sorted([cell(term) for term in row.values()] for row in expected)


def test_rooms_lie_on_the_plan_where_they_are(page: Page, url: str) -> None:
    """The shapes are as many as the geometries, and as large as GEOS finds them."""
    ask(page, HOUSE[OUTLINES]["sparql"], view="map")
    rows = answer(url, HOUSE[OUTLINES]["sparql"])
    found = page.evaluate(
        "[...document.querySelectorAll('.plan .shape')].map((shape) => "
        "{ const { x, y, width, height } = shape.getBBox();"
        "return [shape.querySelector('title').textContent, x, -y - height, x + width, -y] })"
    )
    assert len(found) == len(rows) == 4
    bounds = {text: box for text, *box in found}
    labels = page.locator(".plan text").all_text_contents()
    for row in rows:
        name = row["room"]["value"].rsplit("#")[-1]
        outline = shapely.from_wkt(row["outline"]["value"])
        assert bounds[f"room: {name}"] == pytest.approx(outline.bounds, abs=1e-4)
        assert name in labels


@pytest.mark.parametrize("nearer", [0, 400])
def test_the_plan_has_a_scale_and_tells_places(page: Page, url: str, nearer: int) -> None:
    """Places and lengths are those of the kitchen, also after the wheel came nearer."""
    ask(page, HOUSE[OUTLINES]["sparql"], view="map")
    kitchen = page.locator(".plan .shape").filter(has_text="kitchen").locator("path")
    before = kitchen.bounding_box()
    page.mouse.move(before["x"] + before["width"] / 2, before["y"] + before["height"] / 2)
    width = page.evaluate("document.querySelector('.plan').viewBox.baseVal.width")
    page.mouse.wheel(0, -nearer)
    until(page, "document.querySelector('.foot output').value !== ''")
    if nearer:
        until(page, "(wide) => document.querySelector('.plan').viewBox.baseVal.width < wide", width)
    box = kitchen.bounding_box()
    (row,) = answer(url, "SELECT ?g { :kitchen geo:hasDefaultGeometry/geo:asWKT ?g }")
    west, south, east, north = shapely.from_wkt(row["g"]["value"]).bounds
    x, y = page.locator(".foot output").inner_text().replace(" m", "").split(", ")
    pixel = (east - west) / box["width"]
    assert float(x.removeprefix("x ")) == pytest.approx((west + east) / 2, abs=2 * pixel)
    assert float(y.removeprefix("y ")) == pytest.approx((south + north) / 2, abs=2 * pixel)
    bar = page.locator(".foot .scale")
    metres = float(bar.inner_text().removesuffix(" m"))
    assert bar.bounding_box()["width"] * pixel == pytest.approx(metres, rel=0.05)


WKT = [
    "POINT Z (1 2 3)",
    "MULTIPOINT((0 0),(1 1))",
    "LINESTRING(0 0, 1e1 -3)",
    "POLYGON((0 0, 4 0, 4 4, 0 4, 0 0), (1 1, 2 1, 2 2, 1 2, 1 1))",
    "MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)), ((5 5, 6 5, 6 6, 5 5)))",
    "GEOMETRYCOLLECTION(POINT(5 5), LINESTRING(0 0, 1 3))",
    "TIN(((0 0, 1 0, 0 1, 0 0)), ((0 0, -2 0, 0 2, 0 0)))",
]
GEOJSON = '{"type": "Polygon", "coordinates": [[[7, 7], [9, 7], [9, 8], [7, 7]]]}'
ELSEWHERE = "<http://www.opengis.net/def/crs/EPSG/0/25832> POINT(400000 5700000)"


def test_each_kind_of_geometry_is_drawn(page: Page) -> None:
    """One of another reference system is not, and the page says so."""
    given = [f'"{text}"^^geo:wktLiteral' for text in [*WKT, "POINT EMPTY", ELSEWHERE]]
    text = "SELECT ?g { VALUES ?g { " + " ".join(given) + f" '{GEOJSON}'^^geo:geoJSONLiteral }} }}"
    ask(page, text, view="map")
    boxes = page.evaluate(
        "[...document.querySelectorAll('.plan .shape')].map((shape) => "
        "{ const all = [...shape.children].slice(1).flatMap((part) => part.matches('circle') ? "
        "[[part.cx.baseVal.value, -part.cy.baseVal.value]] : "
        "[part.getBBox()].flatMap((b) => [[b.x, -b.y], [b.x + b.width, -b.y - b.height]]));"
        "const of = (i) => all.map((point) => point[i]);"
        "return [Math.min(...of(0)), Math.min(...of(1)), Math.max(...of(0)), Math.max(...of(1))] })"
    )
    same = [text.replace("TIN", "MULTIPOLYGON") for text in WKT]  # GEOS does not read TIN
    shapes = [*map(shapely.from_wkt, same), shapely.from_geojson(GEOJSON)]
    expected = [list(shape.bounds) for shape in shapes]
    assert sorted(boxes) == [pytest.approx(box, abs=1e-5) for box in sorted(expected)]
    assert (
        "8 geometries; 2 that are empty, in another reference system"
        in page.locator(".foot").inner_text()
    )
    inside = page.evaluate(
        "[[1.5, -1.5], [3, -3]].map((at) => [...document.querySelectorAll('.plan .shape path')]"
        ".some((path) => path.getBBox().width === 4 && path.isPointInFill(new DOMPoint(...at))))"
    )
    assert inside == [False, True]  # the hole of the polygon, and beside it


def test_queries_stay_in_the_browser_and_answers_do_not(page: Page, url: str) -> None:
    text = "SELECT ?x { ?x a semmap:Room }"
    ask(page, text)
    stored = page.evaluate("JSON.stringify(localStorage)")
    assert "semmap:Room" in stored
    assert "living-room" not in stored
    page.reload()
    page.evaluate("semmap.ready")
    assert page.evaluate("semmap.yasgui.getTab().getQuery()") == text
    page.evaluate("semmap.yasgui.getTab().query()")
    page.get_by_text(":living-room").wait_for()


def test_a_table_without_geometries_has_no_plan(page: Page) -> None:
    ask(page, "SELECT ?x { ?x a semmap:Chair }")
    until(page, "document.querySelector('.tabPanel.active .select_map.disabled') !== null")


def test_what_the_endpoint_refuses_is_shown(page: Page, url: str) -> None:
    text = "SELECT ?x (COUNT(?y) AS ?n) { ?x semmap:heldBy ?y }"
    ask(page, text)
    shown = page.locator(".tabPanel.active .errorResult")
    shown.wait_for()
    refused = httpx.get(f"{url}/maps/house/rdf/sparql", params={"query": text})
    assert refused.status_code == 400
    assert shown.inner_text().strip() == refused.json()["error"]


def test_a_name_that_the_map_lacks_is_noted(page: Page) -> None:
    ask(page, "SELECT ?x { ?x semmap:heldBy :kitchn }")
    until(page, "document.getElementById('note').value.includes('kitchn')")
    ask(page, "SELECT ?x { ?x semmap:heldBy :kitchen }")
    until(page, "document.getElementById('note').value === ''")


def test_examples_name_what_the_map_has(page: Page, browser: Any, db: Any, url: str) -> None:
    offered = page.locator("#examples option").all_text_contents()
    assert set(HOUSE) <= {*offered}
    db.create_map("flat")
    with opened(browser, f"{url}/query?map=flat") as (other, _):
        offered = other.locator("#examples option").all_text_contents()
    assert OUTLINES in offered
    assert "What is on the kitchen table?" not in offered
    db.drop_map("flat")


def test_the_prefixes_are_those_of_the_map(page: Page, url: str) -> None:
    known = httpx.get(f"{url}/maps/house/rdf/prefixes").json()
    assert known == prefixes("house")
    page.get_by_text("Prefixes of the map").click()
    assert page.locator("#prefixes").inner_text().splitlines()[::2] == [f"{p}:" for p in known]
    assert GEO in page.locator("#prefixes").inner_text()


def test_a_token_goes_with_queries_and_nowhere_else(browser: Any, db: semmap.Database) -> None:
    with (
        served(db, {TOKEN: "semmap_admin"}, local=False) as url,
        opened(browser, f"{url}/query?map=house#token={TOKEN}") as (page, asked),
    ):
        ask(page, "SELECT ?x { ?x a semmap:Room }")
        assert page.locator(".tabPanel.active tbody tr").count() == 4
        sent = [each for each in asked if "/rdf/sparql" in each.url and each.method == "POST"]
        assert [each.all_headers()["authorization"] for each in sent] == [f"Bearer {TOKEN}"]
        assert TOKEN not in page.url
        assert page.evaluate("JSON.stringify(localStorage)").count(TOKEN) == 0
        link = page.evaluate("semmap.yasgui.getTab().getShareableLink()")
        assert "semmap%3ARoom" in link
        assert TOKEN not in link
        command = page.evaluate("semmap.yasgui.getTab().getYasqe().getAsCurlString()")
        assert command.startswith("curl ")
        assert TOKEN not in command


def test_without_a_token_the_page_says_that_it_needs_one(browser: Any, db: Any) -> None:
    with served(db, {TOKEN: "semmap_admin"}, local=False) as url:
        page = browser.new_page()
        page.goto(f"{url}/query?map=house")
        until(page, "document.getElementById('note').value.includes('needs a token')")
        page.close()


def test_a_link_sets_a_query_and_does_not_run_it(browser: Any, url: str) -> None:
    """Else a link could change the map with the token of a tab."""
    text = "DELETE WHERE { ?x rdfs:label ?l }"
    address = f"{url}/query?map=house#{httpx.QueryParams(query=text, endpoint='http://192.0.2.1/')}"
    with opened(browser, address) as (page, asked):
        assert page.evaluate("semmap.yasgui.getTab().getQuery()") == text
        page.wait_for_timeout(500)
        assert [each.url for each in asked if each.method == "POST"] == []


def test_the_viewer_and_the_page_link_to_each_other(page: Page) -> None:
    page.locator("#viewer").click()
    page.wait_for_url("**/view/?map=house*")
    page.evaluate("semmap.ready")
    page.get_by_role("link", name="Query page").click()
    page.wait_for_url("**/view/query.html?map=house*")
    page.evaluate("semmap.ready")
    assert page.locator("#map-name").inner_text() == "Query house"


def test_an_entity_in_a_table_leads_to_it_in_the_viewer(page: Page) -> None:
    ask(page, "SELECT ?x { ?x semmap:placedOn :KitchenTable_01_001 }")
    page.locator(".tabPanel.active td a.iri").click()
    page.get_by_role("heading", name="Tableware_01_001", exact=True).wait_for()


def test_the_editor_finds_no_fault_in_examples(page: Page) -> None:
    faults = page.evaluate(
        "() => { const editor = semmap.yasgui.getTab().getYasqe();"
        "return [...document.querySelectorAll('#examples optgroup option')].filter((each) => "
        "{ editor.setValue(each.value); return !editor.queryValid }).map((each) => each.text) }"
    )
    assert faults == []


def test_a_prefix_is_declared_as_it_is_typed(page: Page) -> None:
    """As the map has it: other lists have another `prop:`."""
    page.evaluate("void semmap.yasgui.getTab().setQuery('SELECT ?x { ?x ')")
    page.evaluate("semmap.yasgui.getTab().getYasqe().getDoc().setCursor(0, 15)")
    page.locator(".tabPanel.active .CodeMirror").press_sequentially("prop:")
    until(page, "semmap.yasgui.getTab().getQuery().startsWith('PREFIX prop: ')")
    assert f"<{prefixes('house')['prop']}>" in page.evaluate("semmap.yasgui.getTab().getQuery()")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_can_be_read_in_light_and_dark(browser: Any, url: str, scheme: str) -> None:
    """The contrast of WCAG 2.1 is at least 4.5 for the editor, the table and the plan."""
    with opened(browser, f"{url}/query?map=house", color_scheme=scheme) as (page, _):
        ask(page, HOUSE[OUTLINES]["sparql"])
        for place in (".CodeMirror", ".yasr_results td", ".yasr_results th", ".tab.active a"):
            assert contrast(page, f".active {place}, .tabsList {place}") > 4.5, place
        page.locator(".tabPanel.active .select_map").click()
        assert contrast(page, ".plan text", "fill") > 4.5


def contrast(page: Page, place: str, ink: str = "color") -> float:
    """The ratio of luminances of text and what is behind it."""
    colours = page.evaluate(
        "([place, ink]) => { let each = [...document.querySelectorAll(place)]"
        ".find((found) => found.getClientRects().length);"
        "const colour = getComputedStyle(each)[ink]; let behind;"
        "do { behind = getComputedStyle(each).backgroundColor; each = each.parentElement }"
        "while (/, 0\\)$/.test(behind) && each); return [colour, behind] }",
        [place, ink],
    )
    one, other = sorted(map(luminance, colours))
    return (other + 0.05) / (one + 0.05)


def luminance(colour: str) -> float:
    parts = [float(each) / 255 for each in colour.split("(")[1].strip(")").split(",")[:3]]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return sum(weight * p for weight, p in zip((0.2126, 0.7152, 0.0722), linear, strict=True))
