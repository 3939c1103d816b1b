from dataclasses import replace
from datetime import datetime, time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.cost_rules import CostRule, CostRules, CostRulesError, avoiding, penalties
from planner.routing_graph import RoutingGraph
from planner.topology import Place, PlaceRegion, Topology
from tests.planner.office import office


def parse(rules):
    return CostRules.parse(rules, "mine.yaml")


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("rules: [", r"(?s)mine.yaml: is not valid YAML: .*line 1"),
        ("rules: [{name: 2024-13-45}]", "mine.yaml: is not valid YAML: month must be"),
        ("[" * 5000, "mine.yaml: is not valid YAML"),
        ("", "mine.yaml: there is no list of rules; write rules"),
        ("- name: a", "mine.yaml: there is no list of rules; write rules"),
        ("rules: {name: a}", "there is no list of rules"),
        ("rulez: []", "there is no list of rules"),
        ("{rules: [], rulez: [], 1: 2}", "mine.yaml: unknown key 1, rulez; the only key is rules"),
        ("rules: [lab1]", "mine.yaml: rule 1: unknown key 'lab1'; the keys are forbid, from, kind"),
        (
            "rules: [{name: a, forbid: true}, {nam: b, 1: 2, seconds: 3}]",
            "rule 2: unknown key 1, nam",
        ),
        ("rules: [{kind: room, seconds: 3}]", "rule 1: kind 'room' is not one of place, connector"),
        ("rules: [{kind: [place], seconds: 3}]", r"kind \['place'\] is not one of place"),
        ("rules: [{name: a}]", "rule 1: give seconds above 0, or forbid: true"),
        ("rules: [{name: a, seconds: 0}]", "give seconds above 0, or forbid: true"),
        ("rules: [{name: a, seconds: -3}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: .inf}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: .nan}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: true}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: long}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: 3, forbid: true}]", "give seconds above 0, or forbid"),
        ("rules: [{name: a, forbid: 1}]", "give seconds above 0, or forbid: true"),
        ("rules: [{seconds: 3}]", "rule 1: selects everything; give a kind, name"),
        ("rules: [{name: [], seconds: 3}]", "rule 1: selects everything"),
        ("rules: [{properties: {}, seconds: 3}]", "rule 1: selects everything"),
        ("rules: [{name: 3, seconds: 3}]", r"rule 1: name: give a word or a list of words, not 3"),
        ("rules: [{type: [ward, 3], seconds: 3}]", "rule 1: type: give a word or a list of words"),
        ("rules: [{name: [''], seconds: 3}]", "rule 1: name: give a word"),
        ("rules: [{properties: [a], seconds: 3}]", r"properties: give key: value, not \['a'\]"),
        (
            "rules: [{name: a, seconds: 3, from: '22:00'}]",
            'hours are invalid; write from: "22:00" and until',
        ),
        ("rules: [{name: a, seconds: 3, from: 22:00, until: 06:00}]", "in quotes"),
        (
            "rules: [{name: a, seconds: 3, from: '24:00', until: '06:00'}]",
            "hours are invalid; write from",
        ),
        (
            "rules: [{name: a, seconds: 3, from: '22:00+01:00', until: '06:00'}]",
            "hours are invalid; write from",
        ),
        (
            "rules: [{name: a, seconds: 3, from: '22:00', until: '22:00'}]",
            "hours are invalid; write from",
        ),
    ],
)
def test_a_mistake_is_said_with_file_rule_and_mend(said, message):
    with pytest.raises(CostRulesError, match=message):
        parse(said)


@given(st.text(max_size=40))
def test_any_text_is_rules_or_an_error_of_ours(said):
    for text in (said, f"rules: [{said}]", f"rules: [{{name: a, seconds: {said}}}]"):
        try:
            found = parse(text)
        except CostRulesError as wrong:
            said_of = str(wrong)
        else:
            said_of = f"mine.yaml: {len(found.rules)}"
        assert said_of.startswith("mine.yaml: ")


def test_files_are_read_and_ones_that_are_not_there_named(tmp_path):
    (tmp_path / "mine.yaml").write_text("rules: [{name: lab1, seconds: 3}]")
    assert CostRules.read(tmp_path / "mine.yaml").rules == (CostRule(3.0, names=("lab1",)),)
    for wrong in (tmp_path, tmp_path / "other.yaml"):
        with pytest.raises(CostRulesError, match=f"{wrong}: cannot be read.* Name a file of rules"):
            CostRules.read(wrong)
    (tmp_path / "mine.yaml").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(CostRulesError, match="cannot be read"):
        CostRules.read(tmp_path / "mine.yaml")


def test_the_rules_that_come_with_the_planner():
    ward = next(r for r in CostRules.default().rules if r.types)
    assert (ward.types, ward.hours, ward.seconds) == (("ward",), (time(22), time(6)), 300.0)


@given(st.times(), st.times(), st.times())
def test_hours_go_around_midnight(begin, end, now):
    rule = CostRule(1.0, names=("a",), hours=(begin, end))
    day = datetime.combine(datetime(2024, 5, 5), now)
    minute = [
        t.hour * 3600e6 + t.minute * 60e6 + t.second * 1e6 + t.microsecond
        for t in (begin, end, now)
    ]
    after = (minute[2] - minute[0]) % 86400e6
    assert rule.applies_at(day) == (after < (minute[1] - minute[0]) % 86400e6)
    assert not rule.applies_at(None)


def test_rules_fit_places_connectors_and_regions_and_add_up():
    topology = office(door6={"properties": {"squeaks": True}})
    topology.places["lab2"] = Place(
        "lab2", type="day_ward", types=("day_ward", "ward", "room"), storey="floor-3rd"
    )
    graph = RoutingGraph(topology)
    rules = parse(
        "rules: [{type: ward, seconds: 5}, {name: lab2, seconds: 7}, {kind: connector, "
        "properties: {squeaks: true}, seconds: 11}, {kind: region, name: lab2, seconds: 13}, "
        "{name: door2, forbid: true}]"
    )
    found = penalties(graph, rules.rules)
    coming = set(graph.edges_into("lab2"))
    assert {graph.connectors[e // 2].name for e in coming} == {"door8"}
    door6 = {2 * graph.index["door6"], 2 * graph.index["door6"] + 1}
    assert found.seconds == dict.fromkeys(coming, 12.0) | dict.fromkeys(door6, 11.0)
    door2 = {2 * graph.index["door2"], 2 * graph.index["door2"] + 1}
    assert found.blocked == dict.fromkeys(door2, "door2 is to be avoided")


def test_the_ward_is_gone_around_at_night():
    """office4 has two doors; through it is a way from door6 to door7 of the corridor."""
    topology = office()
    topology.places["corridor1"] = replace(topology.places["corridor1"], types=("ward",))
    graph = RoutingGraph(topology)
    night, day = datetime(2024, 5, 5, 23), datetime(2024, 5, 5, 12)
    rules = CostRules.default().rules
    assert not penalties(graph, rules, day).seconds
    assert set(penalties(graph, rules, night).seconds.values()) == {300.0}


def test_without_costmaps_a_region_is_its_room():
    region = PlaceRegion("wet", None, ("corridor1",))
    graph = RoutingGraph(
        Topology.of(office().places.values(), office().connectors.values(), [region])
    )
    found = penalties(graph, avoiding(["wet"]))
    assert set(found.blocked) == set(graph.edges_into("corridor1"))
