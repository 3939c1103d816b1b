import time

import pytest

from semmap.yaml_file import parse_yaml, read_text


class MendError(ValueError):
    """What a caller calls its errors."""


def test_what_is_written_is_read(tmp_path):
    file = tmp_path / "said.yaml"
    file.write_text("a: [1, two]", "utf-8")
    assert parse_yaml(read_text(file, "a file", MendError), "said", MendError) == {"a": [1, "two"]}


@pytest.mark.parametrize("text", ["a: [1", "when: 2024-13-45", "[" * 3000, "a: !!python/none x"])
def test_what_is_no_yaml_is_refused_in_the_callers_words(text):
    with pytest.raises(MendError, match=r"^mine\.yaml: is not valid YAML"):
        parse_yaml(text, "mine.yaml", MendError)


LAUGHS = "a0: &a0 [x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 30)
)

UNBOUNDED = {
    "aliases that multiply": (LAUGHS, "line 8 has 2,.* values, the limit is 2,000,000 values"),
    "an alias of itself": ("a: &a [*a]", r"line 1 has an alias \*a that contains itself"),
    "merges that multiply": (
        "a0: &a0 {x: 1}\n"
        + "".join(f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}\n" for i in range(1, 30)),
        "the limit is 2,000,000 values",
    ),
    "nesting": ("a: " + "[" * 65, "line 1 nests 65 levels, the limit is 64 levels"),
    "mappings in mappings": ("{a: " * 65, "the limit is 64 levels"),
    "a number in base 60": ("a: " + ":".join(["1"] * 100_000), "has a number of 199999 digits"),
    "a number of many digits": ("a: " + "9" * 100_000, "has a number of 100000 digits"),
}


@pytest.mark.parametrize("name", UNBOUNDED)
def test_what_would_take_gigabytes_or_minutes_is_refused(name):
    text, message = UNBOUNDED[name]
    start = time.process_time()
    with pytest.raises(MendError, match=rf"^mine\.yaml: is not valid YAML: .*{message}"):
        parse_yaml(text, "mine.yaml", MendError)
    assert time.process_time() - start < 5


def test_aliases_are_followed():
    text = "a: &a [1, 2]\nb: {c: *a, d: &s word, e: *s}"
    assert parse_yaml(text, "mine.yaml", MendError) == {
        "a": [1, 2],
        "b": {"c": [1, 2], "d": "word", "e": "word"},
    }


def test_a_file_has_a_limit(tmp_path, monkeypatch):
    file = tmp_path / "large.yaml"
    file.write_text("# " + "x" * 2**20)
    with pytest.raises(
        MendError, match=r"has 1,048,578 bytes, the limit is 1 MiB. Name .*CONFIG_BYTES"
    ):
        read_text(file, "a policy file", MendError)
    monkeypatch.setenv("SEMMAP_MAX_CONFIG_BYTES", "2e6")
    assert len(read_text(file, "a policy file", MendError)) == 2**20 + 2


def test_what_is_no_text_is_refused(tmp_path):
    for name, content in (("none", None), ("bytes", b"\xff\xfe")):
        file = tmp_path / name
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(MendError, match=r"cannot be read: .*Name a policy file"):
            read_text(file, "a policy file", MendError)
