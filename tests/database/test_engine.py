"""Which database is meant, and what each connection has."""

from __future__ import annotations

import pytest
from sqlalchemy import Engine

from semmap.database import DatabaseError, database_url, open_engine


def test_session_settings(engine: Engine) -> None:
    with engine.connect() as connection:
        for setting, value in {
            "search_path": "semmap,public",
            "TimeZone": "UTC",
            "application_name": "semmap",
            "server_encoding": "UTF8",
        }.items():
            assert connection.exec_driver_sql(f"SHOW {setting}").scalar() == value


def test_url_from_environment(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_DB", database.replace("postgresql+psycopg", "postgresql"))
    assert database_url().render_as_string(hide_password=False) == database


def test_url_options_are_kept(database: str) -> None:
    engine = open_engine(database + "&options=-c%20work_mem%3D7MB&application_name=robot")
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SHOW work_mem").scalar() == "7MB"
        assert connection.exec_driver_sql("SHOW search_path").scalar() == "semmap,public"
        assert connection.exec_driver_sql("SHOW application_name").scalar() == "robot"
    engine.dispose()


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("sqlite:///x", "needs PostgreSQL"),
        ("nonsense", "cannot be read"),
        ("postgresql://u:secret@127.0.0.1:1/none", "Is the server running"),
        ("postgresql://u@/none?host=/no/such/folder", "no socket directory /no/such/folder"),
    ],
)
def test_unusable_url(url: str, said: str) -> None:
    with pytest.raises(DatabaseError, match=said) as caught:
        open_engine(url)
    assert "secret" not in str(caught.value)
