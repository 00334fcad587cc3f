"""What a diagnosis is asked for, and the files it names, read and checked."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tasks.capture.tracked_geometry import TrackedGeometry, read_tracked_geometry
from tasks.cloth.windows import Recording
from tasks.effects.effect import Effect
from tasks.effects.library import library, suspects
from tasks.effects.named import named
from tasks.gap.garment_recordings import Garment, garment_recordings, recording
from tasks.geometry.faults import BadInput, Fault, refuse


@dataclass(frozen=True)
class Request:
    """Files of one garment: recordings to learn from, recordings held out, a blind file and where its prediction goes; effects to leave
    out.

    report: HTML page to write; the answer and its evidence go beside it as JSON. fps [1/s], up: instead of what the files say.
    """

    tracks: tuple[Path, ...]
    held_out: tuple[Path, ...] = ()
    predict: Path | None = None
    out: Path | None = None
    quick: bool = False
    without: tuple[str, ...] = ()
    plugins: Path | None = None
    report: Path | None = None
    fps: float | None = None
    up: Literal["y", "z"] | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """Those that are read before work starts, each once."""
        return tuple(dict.fromkeys((*self.tracks, *([self.predict] if self.predict else []))))


@dataclass(frozen=True)
class Inputs:
    """The suspects, the garment with its recordings, the blind one, and sentences on what the files leave in doubt."""

    effects: tuple[Effect, ...]
    garment: Garment
    blind: Recording | None
    warnings: tuple[str, ...]

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """Those that are not held out."""
        return (*self.garment.recordings, *([self.blind] if self.blind else []))


def read(request: Request) -> Inputs:
    """What a request names, but for files held out, which need only be there. Raises BadInput with everything that is wrong with any of it."""
    faults, tracks, left_out = _faults(request), {}, ()
    known = library(request.plugins)
    with _collected(faults):
        left_out = named(request.without, known, "--without")
    for path in request.files:
        if path.exists():
            with _collected(faults):
                tracks[path] = read_tracked_geometry(path, fps=request.fps, up=request.up)
    refuse(faults)
    unseen = (tracks[request.predict], str(request.predict)) if request.predict else None
    garment = garment_recordings([tracks[p] for p in request.tracks], [str(p) for p in request.tracks], blind=unseen)
    blind = recording(tracks[request.predict], str(request.predict), garment, blind=True) if request.predict else None
    warnings = [w for p in request.files for w in tracks[p].warnings] + _chosen(garment, [tracks[p] for p in request.tracks])
    return Inputs(tuple(suspects(e for e in known.values() if e not in left_out)), garment, blind, tuple(warnings))


def held_out(request: Request, garment: Garment) -> tuple[list[Recording], list[str]]:
    """Recordings held out, now read, and the warnings of their files. Raises BadInput with everything that is wrong with any of them."""
    faults: list[Fault] = []
    found, warnings = [], []
    for path in request.held_out:
        with _collected(faults):
            track = read_tracked_geometry(path, fps=request.fps, up=request.up)
            warnings += track.warnings
            found.append(recording(track, str(path), garment))
    refuse(faults)
    return found, warnings


@contextmanager
def _collected(faults: list[Fault]) -> Iterator[None]:
    """Faults raised in the block are added, and it ends there."""
    try:
        yield
    except BadInput as bad:
        faults += bad.faults


def _chosen(garment: Garment, tracks: Sequence[TrackedGeometry]) -> list[str]:
    """Of what was chosen for the garment, what a diagnosis rests on: how it is held, where no file says it, and what is doubtful."""
    told = any(len(track.boundary) for track in tracks)
    return [said for said in garment.chosen if said.startswith(("doubtful: ",) if told else ("boundary: ", "doubtful: "))]


def _faults(request: Request) -> list[Fault]:
    """What is wrong with the request, files unread."""
    faults = [
        Fault(str(p), "there is no such file or folder", "Give an NPZ of tracked geometry, or a folder of meshes.")
        for p in (*request.files, *request.held_out)
        if not p.exists()
    ]
    faults += _same_file_faults(request)
    if not request.tracks:
        faults.append(Fault("gap run", "names no recording", "Give at least one NPZ or folder."))
    if (request.predict is None) != (request.out is None):
        faults.append(Fault("--predict and --out", "one is given without the other", "Give both."))
    faults += [] if request.out is None else _place_faults("--out", request.out)
    if request.report is not None and request.report.suffix != ".html":
        faults.append(Fault(f"--report {request.report}", "does not end in .html", "Name an HTML page; its JSON goes beside it."))
    return faults + ([] if request.report is None else _place_faults("--report", request.report))


def _same_file_faults(request: Request) -> list[Fault]:
    """One file by two names: a recording twice, one both learnt from and held out, and what would be written over another."""
    faults: list[Fault] = []
    learnt: dict[Path, Path] = {}
    held: dict[Path, Path] = {}
    for option, paths, known in (("", request.tracks, learnt), ("--held-out ", request.held_out, held)):
        for path in filter(Path.exists, paths):
            file = path.resolve()
            if file in known:
                faults.append(Fault(f"{option}{path}", f"is the same recording as {known[file]}", "Name each recording once."))
            elif file in learnt:
                faults.append(Fault(f"{option}{path}", f"is also a recording to learn from, {learnt[file]}", "Hold out another."))
            known.setdefault(file, path)
    taken = {path.resolve(): str(path) for path in (*request.files, *request.held_out) if path.exists()}
    for option, said, path in _written(request):
        file = path.resolve()
        if file in taken:
            faults.append(Fault(option, f"{said}would overwrite {taken[file]}", "Choose another place."))
        taken.setdefault(file, option)
    return faults


def _written(request: Request) -> list[tuple[str, str, Path]]:
    """Every file to be written: the option, what it is beside what the option names, and where."""
    found = [] if request.out is None else [(f"--out {request.out}", "", request.out)]
    page = request.report
    if page is None or page.suffix != ".html":
        return found
    beside = page.with_suffix(".json")
    return [*found, (f"--report {page}", "", page), (f"--report {page}", f"the JSON beside it, {beside}, ", beside)]


def _place_faults(option: str, path: Path) -> list[Fault]:
    """Why no file can be put there."""
    if path.is_dir():
        return [Fault(f"{option} {path}", "is a folder", "Name a file in it.")]
    if not path.parent.is_dir():
        return [Fault(f"{option} {path}", "its folder does not exist", "Create it, or choose another.")]
    return []
