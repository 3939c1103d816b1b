from dataclasses import replace
from datetime import datetime, time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.network import Network
from planner.rules import Rule, Rules, RulesError, forbid, penalties
from planner.topology import Place, Region, Topology
from tests.planner.office import office


def parse(rules):
    return Rules.parse(rules, "mine.yaml")


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("rules: [", r"(?s)mine.yaml: is not valid YAML: .*line 1"),
        ("rules: [{name: 2024-13-45}]", "mine.yaml: is not valid YAML: month must be"),
        ("[" * 5000, "mine.yaml: is not valid YAML"),
        ("", "mine.yaml: needs rules as a list"),
        ("- name: a", "mine.yaml: needs rules as a list"),
        ("rules: {name: a}", "needs rules as a list"),
        ("rulez: []", "needs rules as a list"),
        ("{rules: [], rulez: [], 1: 2}", "mine.yaml: knows no 1, rulez; it takes rules"),
        ("rules: [lab1]", "mine.yaml: rule 1: knows no 'lab1'; it takes forbid, from, kind"),
        ("rules: [{name: a, forbid: true}, {nam: b, 1: 2, seconds: 3}]", "rule 2: knows no 1, nam"),
        ("rules: [{kind: room, seconds: 3}]", "rule 1: its kind is one of place, connector"),
        ("rules: [{kind: [place], seconds: 3}]", "rule 1: its kind is one of place, connector"),
        ("rules: [{name: a}]", "rule 1: give seconds above 0, or forbid: true"),
        ("rules: [{name: a, seconds: 0}]", "give seconds above 0, or forbid: true"),
        ("rules: [{name: a, seconds: -3}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: .inf}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: .nan}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: true}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: long}]", "give seconds above 0"),
        ("rules: [{name: a, seconds: 3, forbid: true}]", "give seconds above 0, or forbid"),
        ("rules: [{name: a, forbid: 1}]", "give seconds above 0, or forbid: true"),
        ("rules: [{seconds: 3}]", "rule 1: fits everything; name a kind, a name"),
        ("rules: [{name: [], seconds: 3}]", "rule 1: fits everything"),
        ("rules: [{properties: {}, seconds: 3}]", "rule 1: fits everything"),
        ("rules: [{name: 3, seconds: 3}]", "rule 1: name is a word or a list of words, not 3"),
        ("rules: [{type: [ward, 3], seconds: 3}]", "rule 1: type is a word or a list of words"),
        ("rules: [{name: [''], seconds: 3}]", "rule 1: name is a word"),
        ("rules: [{properties: [a], seconds: 3}]", r"properties: give key: value, not \['a'\]"),
        ("rules: [{name: a, seconds: 3, from: '22:00'}]", 'hours are from: "22:00" and until'),
        ("rules: [{name: a, seconds: 3, from: 22:00, until: 06:00}]", "in quotes"),
        ("rules: [{name: a, seconds: 3, from: '24:00', until: '06:00'}]", "hours are from"),
        ("rules: [{name: a, seconds: 3, from: '22:00+01:00', until: '06:00'}]", "hours are from"),
        ("rules: [{name: a, seconds: 3, from: '22:00', until: '22:00'}]", "hours are from"),
    ],
)
def test_a_mistake_is_said_with_file_rule_and_mend(said, message):
    with pytest.raises(RulesError, match=message):
        parse(said)


@given(st.text(max_size=40))
def test_any_text_is_rules_or_an_error_of_ours(said):
    for text in (said, f"rules: [{said}]", f"rules: [{{name: a, seconds: {said}}}]"):
        try:
            found = parse(text)
        except RulesError as wrong:
            said_of = str(wrong)
        else:
            said_of = f"mine.yaml: {len(found.rules)}"
        assert said_of.startswith("mine.yaml: ")


def test_files_are_read_and_ones_that_are_not_there_named(tmp_path):
    (tmp_path / "mine.yaml").write_text("rules: [{name: lab1, seconds: 3}]")
    assert Rules.read(tmp_path / "mine.yaml").rules == (Rule(3.0, names=("lab1",)),)
    for wrong in (tmp_path, tmp_path / "other.yaml"):
        with pytest.raises(RulesError, match=f"{wrong}: cannot be read.* Name a file of rules"):
            Rules.read(wrong)
    (tmp_path / "mine.yaml").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(RulesError, match="cannot be read"):
        Rules.read(tmp_path / "mine.yaml")


def test_the_rules_that_come_with_the_planner():
    ward = next(r for r in Rules.default().rules if r.types)
    assert (ward.types, ward.hours, ward.seconds) == (("ward",), (time(22), time(6)), 300.0)


@given(st.times(), st.times(), st.times())
def test_hours_go_around_midnight(begin, end, now):
    rule = Rule(1.0, names=("a",), hours=(begin, end))
    day = datetime.combine(datetime(2024, 5, 5), now)
    minute = [t.hour * 3600e6 + t.minute * 60e6 + t.second * 1e6 + t.microsecond
              for t in (begin, end, now)]  # fmt: skip
    after = (minute[2] - minute[0]) % 86400e6
    assert rule.holds_at(day) == (after < (minute[1] - minute[0]) % 86400e6)
    assert not rule.holds_at(None)


def test_rules_fit_places_connectors_and_regions_and_add_up():
    topology = office(door6={"properties": {"squeaks": True}})
    topology.places["lab2"] = Place(
        "lab2", type="day_ward", types=("day_ward", "ward", "room"), storey="floor-3rd"
    )
    network = Network(topology)
    rules = parse(
        "rules: [{type: ward, seconds: 5}, {name: lab2, seconds: 7}, {kind: connector, "
        "properties: {squeaks: true}, seconds: 11}, {kind: region, name: lab2, seconds: 13}, "
        "{name: door2, forbid: true}]"
    )
    found = penalties(network, rules.rules)
    coming = set(network.entering("lab2"))
    assert {network.connectors[e // 2].name for e in coming} == {"door8"}
    door6 = {2 * network.index["door6"], 2 * network.index["door6"] + 1}
    assert found.seconds == dict.fromkeys(coming, 12.0) | dict.fromkeys(door6, 11.0)
    door2 = {2 * network.index["door2"], 2 * network.index["door2"] + 1}
    assert found.bars == dict.fromkeys(door2, "door2 is to be avoided")


def test_the_ward_is_gone_around_at_night():
    """office4 has two doors; through it is a way from door6 to door7 of the corridor."""
    topology = office()
    topology.places["corridor1"] = replace(topology.places["corridor1"], types=("ward",))
    network = Network(topology)
    night, day = datetime(2024, 5, 5, 23), datetime(2024, 5, 5, 12)
    rules = Rules.default().rules
    assert not penalties(network, rules, day).seconds
    assert set(penalties(network, rules, night).seconds.values()) == {300.0}


def test_without_costmaps_a_region_is_its_room():
    region = Region("wet", None, ("corridor1",))
    network = Network(Topology.of(office().places.values(), office().connectors.values(), [region]))
    found = penalties(network, forbid(["wet"]))
    assert set(found.bars) == set(network.entering("corridor1"))
