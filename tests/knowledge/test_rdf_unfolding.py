"""Small RDF that would take gigabytes or minutes is refused, and ordinary files are not."""

from __future__ import annotations

from pathlib import Path

import pytest

from semmap.ingest.world import WorldError
from semmap.knowledge.rdf_file import parse_facts

RDF = "<r:RDF xmlns:r='http://www.w3.org/1999/02/22-rdf-syntax-ns#' xmlns:a='a:{}'>{}</r:RDF>"
LONG = "x" * 30_000
DEEP = 100_000
TOO_MUCH = {
    "xml that nests": (
        "xml",
        RDF.format("", "<a:C><a:p>" * DEEP + "</a:p></a:C>" * DEEP),
        "levels",
    ),
    "xml cut off": ("xml", RDF.format("", "")[:-3], "not well-formed"),
    "xml names": ("xml", RDF.format(LONG, "<a:C/>" * 20_000), "characters"),
    "objects that nest": ("json-ld", '{"a:b":' * 65_000 + "1" + "}" * 65_000, "levels"),
    "a vocabulary": (
        "json-ld",
        f'{{"@context":{{"@vocab":"a:{LONG}"}},"@graph":['
        + '{"@type":"a"},' * 20_000
        + '{"@type":"a"}]}',
        "characters",
    ),
    "a prefix": ("turtle", f"@prefix : <a:{LONG}> . :a :b {':a,' * 20_000} :a .", "characters"),
    "a base": ("trig", f"@base <a:/{LONG}/> . <a> <b> {'<>,' * 20_000} <> .", "characters"),
    "many facts": ("turtle", f"<a:b> <a:c> {'0,' * 100_001} 0 .", "100,000 values"),
    "a long IRI": ("nt", f"<a:b> <a:c> <a:{'x' * 2**25}> .", "too long"),
}


@pytest.mark.parametrize("name", TOO_MUCH)
def test_rdf_that_unfolds_is_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_MAX_ELEMENTS", "100_000")
    format_, text, problem = TOO_MUCH[name]
    with pytest.raises(WorldError, match=problem):
        parse_facts(text, format_, Path("a"))


def test_marks_in_strings_do_not_nest() -> None:
    many = "[{" * 100
    text = f'{{"@id": "a:a", "a:p": ["{many}", "\\"{many}", "\\\\", ["{many} "]]}}'
    assert len(parse_facts(text, "json-ld", Path("a"))) == 4
    text = RDF.format("", f"<a:C a:p='>'>{'<a:p>1</a:p>' * 200}<!-- {'<a:C>' * 100} --></a:C>")
    assert len(parse_facts(text, "xml", Path("a"))) == 202
