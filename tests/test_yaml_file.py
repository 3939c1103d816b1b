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
    with pytest.raises(MendError, match=r"^mine\.yaml: is no YAML, mend it"):
        parse_yaml(text, "mine.yaml", MendError)


def test_what_is_no_text_is_refused(tmp_path):
    for name, content in (("none", None), ("bytes", b"\xff\xfe")):
        file = tmp_path / name
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(MendError, match=r"cannot be read: .*Name a policy file"):
            read_text(file, "a policy file", MendError)
