"""Settings of a service, from YAML and options; each error names the setting."""

from __future__ import annotations

from pathlib import Path

import pytest

from semmap.fields.service.settings import SourceSettings, read_settings


def test_a_file_and_options(tmp_path: Path) -> None:
    path = tmp_path / "fields.yaml"
    path.write_text(
        "keep_every: 2\nsources:\n  gaze: {rate: 30, options: {reach: 4}}\n"
        "  near: {source: personal_space, percepts: {recording: walk, loop: true}}\n"
    )
    made = read_settings(path, ["bodies:standing_people=socket"], ["bodies=5"])
    assert made.keep_every == 2
    assert made.sources == (
        SourceSettings("gaze", "gaze", "socket", 30.0, options={"reach": 4}),
        SourceSettings("near", "personal_space", {"recording": "walk", "loop": True}),
        SourceSettings("bodies", "standing_people", "socket", 5.0),
    )
    assert read_settings().sources == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sources: [gaze]", "sources is not a mapping"),
        ("sources: {gaze: {rat: 3}}", "sources.gaze.rat is unknown"),
        ("sources: {gaze: {rate: fast}}", "sources.gaze.rate is 'fast'"),
        ("sources: {gaze: {options: 3.5}}", "sources.gaze.options is 3.5: write a mapping"),
        ("keep_evry: 3", "keep_evry is unknown"),
        ("keep_every: -1", "keep_every is -1"),
        (f"keep_every: {'9' * 400}", "keep_every is 999"),
        ("sources: {", "not valid YAML"),
        ("- gaze", "write a mapping"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "fields.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_settings(path)


def test_wrong_options() -> None:
    with pytest.raises(ValueError, match="NAME=PERCEPTS"):
        read_settings(sources=["gaze"])
    with pytest.raises(ValueError, match="there is no source gaze"):
        read_settings(rates=["gaze=3"])
