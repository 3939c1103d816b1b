import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from navgrid.grid import Grid
from navgrid.map_file import MapFileError, read_map, write_map

GRID = Grid(origin=(-1.5, 0.1), resolution=0.05, shape=(2, 3))
CELLS = np.array([[0, 100, -1], [100, 0, 0]], np.int8)

shapes = hnp.array_shapes(min_dims=2, max_dims=2, max_side=7)
trinary_cells = hnp.arrays(np.int8, shapes, elements=st.sampled_from([-1, 0, 100]))
any_cells = hnp.arrays(np.int8, shapes, elements=st.integers(-1, 100))
finite = st.floats(-1e5, 1e5)


def test_the_files_are_those_of_map_saver(tmp_path):
    path = write_map(GRID, CELLS, tmp_path / "map")
    assert path == tmp_path / "map.yaml"
    assert path.read_text().splitlines() == [
        "image: map.pgm",
        "mode: trinary",
        "resolution: 0.05",
        "origin: [-1.5, 0.1, 0.0]",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    ]
    # the first row of the image is the highest y
    expected = b"P5\n3 2\n255\n" + bytes([0, 254, 254, 254, 0, 205])
    assert (tmp_path / "map.pgm").read_bytes() == expected
    assert sorted(p.name for p in tmp_path.iterdir()) == ["map.pgm", "map.yaml"]


@settings(max_examples=60, deadline=None)
@given(trinary_cells, finite, finite, st.floats(1e-6, 10.0))
def test_trinary_maps_come_back_in_full_precision(tmp_path_factory, cells, x, y, resolution):
    grid = Grid(origin=(x, y), resolution=resolution, shape=cells.shape)
    read, back = read_map(write_map(grid, cells, tmp_path_factory.mktemp("m") / "map"))
    assert read == grid
    np.testing.assert_array_equal(back, cells)


@settings(max_examples=60, deadline=None)
@given(any_cells, st.sampled_from(["scale", "raw"]))
def test_scale_and_raw_maps_keep_every_value(tmp_path_factory, cells, mode):
    grid = replace(GRID, shape=cells.shape)
    _, back = read_map(write_map(grid, cells, tmp_path_factory.mktemp("m") / "map", mode))
    np.testing.assert_array_equal(back, cells)


def test_trinary_calls_unknown_what_lies_between_the_thresholds(tmp_path):
    cells = np.array([[-1, 0, 20, 21, 64, 65, 100]], np.int8)
    _, back = read_map(write_map(replace(GRID, shape=(1, 7)), cells, tmp_path / "map"))
    assert back.tolist() == [[-1, 0, 0, -1, -1, 100, 100]]


def test_the_default_threshold_of_map_saver_would_free_the_unknown(tmp_path):
    """Why 0.196 is written: grey 205 has occupancy 0.1961, below 0.25."""
    path = write_map(GRID, CELLS, tmp_path / "map", free_thresh=0.25)
    assert read_map(path)[1][0, 2] == 0
    assert read_map(write_map(GRID, CELLS, tmp_path / "map"))[1][0, 2] == -1


def map_server(pixel, mode, negate, free, occupied):
    """One pixel (colour channels, then alpha or None) after map_server's documented rules."""
    *colours, alpha = pixel
    shades = list(colours)
    if mode == "trinary" and alpha is not None:
        shades.append(alpha)
    shade = sum(shades) / len(shades) / 255
    if mode == "raw":
        value = round(shade * 255)
        return value if 0 <= value <= 100 else -1
    occupancy = shade if negate else 1 - shade
    if mode == "scale" and alpha is not None and alpha < 255:
        return -1
    if occupancy > occupied:
        return 100
    if occupancy < free:
        return 0
    return round((occupancy - free) / (occupied - free) * 100) if mode == "scale" else -1


@settings(max_examples=80, deadline=None)
@given(
    st.sampled_from(["L", "LA", "RGB", "RGBA"]),
    st.sampled_from(["trinary", "scale", "raw"]),
    st.booleans(),
    st.tuples(st.floats(0.05, 0.45), st.floats(0.5, 0.95)),
    st.data(),
)
def test_images_are_read_by_the_rules_of_map_server(
    tmp_path_factory, bands, mode, negate, thresholds, data
):
    pixels = data.draw(hnp.arrays(np.uint8, (2, 3, len(bands))))
    folder = tmp_path_factory.mktemp("m")
    Image.fromarray(pixels.squeeze(-1) if bands == "L" else pixels, mode=None).save(
        folder / "a b.png"
    )
    free, occupied = thresholds
    (folder / "m.yaml").write_text(
        yaml.safe_dump(
            {
                "image": "a b.png",
                "mode": mode,
                "resolution": 1.0,
                "origin": [0, 0, 0],
                "negate": int(negate),
                "free_thresh": free,
                "occupied_thresh": occupied,
            }
        )
    )
    _, cells = read_map(folder / "m.yaml")
    for row in range(2):
        for column in range(3):
            pixel = [int(v) for v in pixels[1 - row, column]]
            if not bands.endswith("A"):
                pixel.append(None)
            assert cells[row, column] == map_server(pixel, mode, negate, free, occupied)


def test_sixteen_bit_images_are_read(tmp_path):
    path = write_map(GRID, CELLS, tmp_path / "map")
    wide = np.array([[0, 65535, 65535], [65535, 0, 50000]], ">u2")
    (tmp_path / "map.pgm").write_bytes(b"P5\n3 2\n65535\n" + wide.tobytes())
    _, cells = read_map(path)
    assert cells.tolist() == [[0, 100, -1], [100, 0, 0]]


def test_writing_anew_replaces_image_and_description(tmp_path):
    write_map(GRID, CELLS, tmp_path / "map")
    larger = replace(GRID, origin=(3.0, 4.0), shape=(4, 6))
    path = write_map(larger, np.zeros((4, 6), np.int8), tmp_path / "map")
    assert read_map(path)[0] == larger
    assert len(list(tmp_path.iterdir())) == 2


def test_a_write_that_fails_leaves_no_halves(tmp_path):
    write_map(GRID, CELLS, tmp_path / "map")
    (tmp_path / "map.pgm").unlink()
    (tmp_path / "map.pgm").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_map(replace(GRID, origin=(9.0, 9.0)), CELLS, tmp_path / "map")
    assert [p.name for p in tmp_path.iterdir()] == ["map.pgm"]


@pytest.mark.parametrize(
    ("change", "element"),
    [
        ({"resolution": None}, "resolution: is missing"),
        ({"resolution": -0.05}, "resolution: is -0.05"),
        ({"resolution": "fine"}, "resolution: is 'fine'"),
        ({"resolution": math.nan}, "resolution: is nan"),
        ({"origin": [0, 0]}, r"origin: is \[0, 0\]"),
        ({"origin": [0, 0, 0.5]}, r"origin\[2\]: turns the map"),
        ({"origin": [0, "a", 0]}, r"origin\[1\]: is 'a'"),
        ({"mode": "colour"}, "mode: is 'colour'. Give one of trinary, scale, raw"),
        ({"negate": None}, "negate: is missing"),
        ({"image": "gone.pgm"}, "image: there is no .*gone.pgm. Put the image there"),
        ({"image": "map.yaml"}, "cannot be read"),
        ({"image": 5}, "image: is 5"),
        ({"free_thresh": "x"}, "free_thresh: is 'x'"),
    ],
)
def test_what_a_map_lacks_is_named(tmp_path, change, element):
    path = write_map(GRID, CELLS, tmp_path / "map")
    said = yaml.safe_load(path.read_text()) | change
    path.write_text(yaml.safe_dump({k: v for k, v in said.items() if v is not None}))
    with pytest.raises(MapFileError, match=f"map.yaml: .*{element}"):
        read_map(path)


@pytest.mark.parametrize(
    "text", ["a: [", "just words", "\x00", "", "a: &a [*a]", "a: " + "[" * 100, "a: 2024-13-45"]
)
def test_a_file_that_is_no_map_is_refused(tmp_path, text):
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(MapFileError, match=r"m\.yaml: file: (is no YAML|has no fields|line 1)"):
        read_map(tmp_path / "m.yaml")
    with pytest.raises(MapFileError, match="is not there"):
        read_map(tmp_path / "other.yaml")


BROKEN = {
    "a chunk of a PNG": lambda png: png[:45] + bytes(20) + png[65:],
    "a PNG that ends": lambda png: png[:60],
    "noise behind the signature": lambda png: png[:8] + bytes(range(200)),
    "no bytes": lambda png: b"",
    "noise": lambda png: bytes(range(256)),
    "a TIFF that names itself": lambda png: b"II*\x00\x08\x00\x00\x00" + b"\xff" * 40,
    "a PGM of text": lambda png: b"P2\n2 2\n255\nmany words",
    "a PGM of no size": lambda png: b"P5\n0 0\n255\n",
    "a PGM below 0": lambda png: b"P5\n-3 -3\n255\n",
    "a PGM of no levels": lambda png: b"P5\n2 2\n0\n0000",
    "an image of a million rows": lambda png: b"P5\n1000000 1000000\n255\n",
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_image_is_refused(tmp_path, name):
    cells = np.random.default_rng(3).integers(0, 101, (20, 30)).astype(np.int8)
    path = write_map(Grid((0, 0), 0.1, (20, 30)), cells, tmp_path / "map", "scale")
    image = tmp_path / "map.png"
    image.write_bytes(BROKEN[name](image.read_bytes()))
    with pytest.raises(MapFileError, match=r"map\.png: image: "):
        read_map(path)


def test_an_image_has_a_limit(tmp_path, monkeypatch):
    path = write_map(GRID, CELLS, tmp_path / "map")
    monkeypatch.setenv("SEMMAP_MAX_PIXELS", str(CELLS.size - 1))
    with pytest.raises(MapFileError, match=r"map\.pgm: image: has \d+ pixels.*SEMMAP_MAX_PIXELS"):
        read_map(path)
    monkeypatch.setenv("SEMMAP_MAX_PIXELS", str(CELLS.size))
    assert (read_map(path)[1] == CELLS).all()


def test_a_large_image_is_read_in_parts(tmp_path):
    cells = np.random.default_rng(4).choice(np.array([-1, 0, 100], np.int8), (700, 50))
    path = write_map(Grid((0, 0), 0.1, cells.shape), cells, tmp_path / "map")
    assert (read_map(path)[1] == cells).all()


def test_a_truncated_image_is_refused(tmp_path):
    path = write_map(GRID, CELLS, tmp_path / "map")
    image = tmp_path / "map.pgm"
    image.write_bytes(image.read_bytes()[:-3])
    with pytest.raises(MapFileError, match=r"map\.pgm: image: cannot be read"):
        read_map(path)


@pytest.mark.parametrize(
    ("cells", "more", "message"),
    [
        (CELLS[:1], {}, "shape"),
        (CELLS + np.int8(20), {}, "120"),
        (CELLS, {"mode": "fancy"}, "one of trinary"),
        (CELLS, {"free_thresh": 0.7}, "free < occupied"),
        (CELLS, {"mode": "scale", "image_format": "pgm"}, "use png"),
    ],
)
def test_what_cannot_be_written_is_said(tmp_path, cells, more, message):
    with pytest.raises(ValueError, match=message):
        write_map(GRID, cells, tmp_path / "map", **more)
    assert list(tmp_path.iterdir()) == []
