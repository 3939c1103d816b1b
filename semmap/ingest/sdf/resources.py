"""The files that an SDF world names, on this machine."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from semmap.ingest.sdf.elements import Unusable
from semmap.ingest.world import WorldError
from semmap.ingest.xml_file import read_xml

PATH_VARIABLES = ("GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH", "SDF_PATH")
"""Environment variables with folders of models, searched last."""

FUEL_VARIABLES = ("GZ_FUEL_CACHE_PATH", "IGN_FUEL_CACHE_PATH")
"""Environment variables with the cache of Gazebo Fuel, by default in the user's folder."""

_ANCESTORS = 4
_LONGEST_PATH = 1024


def model_name(uri: str) -> str:
    """Return the name of the model to which a URI leads: ``desk`` for ``file://models/desk/model.sdf``."""
    rest = unquote(uri.partition("://")[2] or uri).rstrip("/")
    name = rest.rpartition("/")[2]
    if name.lower() in ("model.sdf", "model.config"):
        name = rest.rpartition("/")[0].rpartition("/")[2]
    return name.removesuffix(".sdf") or uri


class Resources:
    """Finds what ``model://``, ``package://`` and ``file://`` URIs and relative paths name.

    Searched in this order: the folders given; the folder of the file that names the URI, and its
    ancestors (four at most), each with the ``models`` folder in it; the folders that the variables
    in `PATH_VARIABLES` list, and those of `package_folders`; for a model of Gazebo Fuel, last its
    local cache. The first part of a ``model://`` or ``package://`` URI may also be an ancestor
    folder that is called otherwise here.
    """

    def __init__(self, model_path: Sequence[Path] = ()) -> None:
        self._given = [Path(p) for p in model_path]
        self._environment = [
            Path(p) for v in PATH_VARIABLES for p in os.environ.get(v, "").split(os.pathsep) if p
        ] + package_folders()

    def find(self, uri: str, named_in: Path, where: str) -> Path:
        """Return what `uri` names in the file `named_in`; `where` is the element, for errors."""
        scheme, separator, rest = uri.strip().partition("://")
        if not separator:
            scheme, rest = "", uri.strip()
        rest = unquote(rest)
        if scheme in ("http", "https", "fuel"):
            found = self.fuel_model(rest, named_in)
            if found is not None:
                return found
            fix = "Download it (gz fuel download -u URL), or give its folder with --model-path."
            raise Unusable(where, f"{uri} is on the network", fix)
        if not rest or not rest.isprintable() or len(rest) > _LONGEST_PATH:
            raise Unusable(where, f"{uri[:80]!r} does not name a file", "Correct the URI.")
        candidates = list(self._candidates(scheme, rest, named_in))
        for candidate in candidates:
            if os.path.exists(candidate):  # noqa: PTH110 - False where a name is too long
                return candidate
        from semmap.ingest.meshes.mesh_file import other_case  # slow to load

        fix = next(filter(None, map(other_case, candidates)), "")
        fix = fix or "Restore it, or give the folder that holds it with --model-path."
        raise Unusable(where, f"{uri} is not found", fix)

    def model_file(self, uri: str, named_in: Path, where: str) -> Path:
        """Return the SDF file that an `<include>` names, of several versions the highest."""
        found = self.find(uri, named_in, where)
        if found.is_file():
            return found
        config = found / "model.config"
        name = _newest_sdf(config) if config.is_file() else "model.sdf"
        for file in (found / name, found / "model.sdf"):
            if os.path.isfile(file):  # noqa: PTH113 - False where a name is too long
                return file
        raise Unusable(where, f"{uri} leads to {found.name}/, which holds no {name}", "Restore it.")

    def fuel_model(self, name: str, named_in: Path) -> Path | None:
        """Return the folder of a model of Fuel, named ``owner/name`` or by its URL; None without.

        A folder of this name, where models are searched, comes before the cache, of which the
        newest version counts.
        """
        *above, last = [part for part in unquote(name).split("/") if part] or [""]
        version = last if last.isdecimal() or last == "tip" else None
        if version is not None and above:
            *above, last = above
        if not last.isprintable() or len(name) > _LONGEST_PATH or last in ("", ".", ".."):
            return None
        for root in self._roots(named_in):
            if os.path.isfile(root / last / "model.sdf"):  # noqa: PTH113 - False for a long name
                return root / last
        owner = next((part for part in reversed(above) if part != "models"), "")
        model = f"*/{glob.escape(owner.lower()) or '*'}/models/{glob.escape(last.lower())}"
        for cache in _fuel_caches():
            known = {v.name: v for v in cache.glob(f"{model}/*") if v.name.isdecimal()}
            wanted = version if version in known else max(known, key=int, default=None)
            if wanted is not None:
                return known[wanted]
        return None

    def _roots(self, named_in: Path) -> Iterator[Path]:
        yield from self._given
        folder = named_in.resolve().parent
        for root in (folder, *folder.parents[:_ANCESTORS]):
            yield root
            yield root / "models"
        yield from self._environment

    def _candidates(self, scheme: str, rest: str, named_in: Path) -> Iterator[Path]:
        if rest.startswith("/"):
            yield Path(rest)
        relative = rest.lstrip("/")
        roots = list(self._roots(named_in))
        yield from (root / relative for root in roots)
        if scheme in ("model", "package") and "/" in relative:
            yield from (root / relative.partition("/")[2] for root in roots)


def package_folders() -> list[Path]:
    """Return the folders of ROS packages, by ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``."""
    return [
        Path(folder) / below
        for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
        for folder in os.environ.get(variable, "").split(os.pathsep)
        if folder
    ]


def _fuel_caches() -> list[Path]:
    stated = [Path(p) for v in FUEL_VARIABLES if (p := os.environ.get(v))]
    return stated or [Path.home() / ".gz" / "fuel", Path.home() / ".ignition" / "fuel"]


def _newest_sdf(config: Path) -> str:
    try:
        root = read_xml(config)
    except WorldError:
        return "model.sdf"
    files = [(_version(e.get("version", "")), (e.text or "").strip()) for e in root.findall("sdf")]
    named = [(version, name) for version, name in files if name]
    return max(named)[1] if named else "model.sdf"


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".") if part.isdecimal())
