"""Recordings of a map's topics: read by MCAP's own decoder, and played to another process."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import semmap
from tests.ros.conftest import Peer, RunNode, new_environment, run, url_of

GRID, MARKERS, FRAMES = "/semmap/ground_floor/grid", "/semmap/markers", "/tf_static"
CHAIR = "ChairA_01_001"


@pytest.fixture(scope="module")
def played_environment() -> dict[str, str]:
    """Another domain: what comes in it is from the player alone."""
    return new_environment()


@pytest.fixture(scope="module")
def recording(
    ros_python: str,
    ros_environment: dict[str, str],
    run_node: RunNode,
    peer: Peer,
    small_house: semmap.Map,
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, Any]:
    """A recording in which a chair is moved, and the last grid as another process got it."""
    file = tmp_path_factory.mktemp("recording") / "house.mcap"
    words = [ros_python, "-m", "semmap_ros.recording", str(file)]
    chair = small_house[CHAIR]
    was = chair.pose
    with run_node(url_of(small_house), "house"):
        peer.listen(GRID, "nav_msgs/msg/OccupancyGrid")
        first = peer.take(GRID)
        process = subprocess.Popen(words, env=ros_environment, stdout=subprocess.PIPE, text=True)
        time.sleep(5.0)
        try:
            chair.move_to(was.x, was.y - 1.0, was.z)
            last = peer.take(GRID, lambda grid: grid["data"] != first["data"])
            time.sleep(2.0)
        finally:
            chair.move_to(was.x, was.y, was.z)
            process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=30)[0].endswith(" messages\n")
        assert process.returncode == 0
    return file, last


def messages(file: Path, topic: str) -> Iterator[Any]:
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for *_, message in reader.iter_decoded_messages(topics=[topic]):
            yield message


def test_all_topics_are_in_it_with_their_definitions(recording: tuple[Path, Any]) -> None:
    file, last = recording
    grids = [*messages(file, GRID)]
    assert len(grids) >= 2  # the latched one, and that after the move
    assert any(np.array_equal(grid.data, last["data"]) for grid in grids)
    assert any(m.text == CHAIR for m in next(messages(file, MARKERS)).markers)
    assert any(
        t.child_frame_id == f"house/{CHAIR}" for t in next(messages(file, FRAMES)).transforms
    )
    labels = next(messages(file, "/semmap/labels"))
    assert "chair" in {each.class_name for each in labels.class_map}
    assert [*messages(file, "/diagnostics")]


def test_a_late_subscriber_gets_what_is_played(
    recording: tuple[Path, Any], ros_python: str, played_environment: dict[str, str]
) -> None:
    file, last = recording
    words = [ros_python, "-m", "semmap_ros.recording", str(file), "--play", "--rate", "20"]
    peer_of = [ros_python, str(Path(__file__).parent / "peer.py")]
    with (
        run([*words, "--stay"], played_environment),
        run(peer_of, played_environment) as process,
    ):
        peer = Peer(process)
        peer.listen(GRID, "nav_msgs/msg/OccupancyGrid")
        grid = peer.take(GRID, lambda grid: grid["data"] == last["data"])
        assert grid["info"] == last["info"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["none.mcap", "--play"], "there is no file"),
        (["kept.mcap"], "exists: give another name"),
        (["new.mcap", "--rate", "0"], "--rate is above 0"),
    ],
)
def test_bad_arguments_write_nothing(
    words: list[str],
    message: str,
    ros_python: str,
    ros_environment: dict[str, str],
    tmp_path: Path,
) -> None:
    (tmp_path / "kept.mcap").write_text("mine")
    done = subprocess.run(
        [ros_python, "-m", "semmap_ros.recording", *words],
        env=ros_environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert message in done.stderr
    assert [each.name for each in tmp_path.iterdir()] == ["kept.mcap"]
    assert (tmp_path / "kept.mcap").read_text() == "mine"
