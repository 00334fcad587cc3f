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
from tasks.gap.recording_faults import recording_faults
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
        """All that are read, each once."""
        return tuple(dict.fromkeys((*self.tracks, *self.held_out, *([self.predict] if self.predict else []))))


@dataclass(frozen=True)
class Inputs:
    """The suspects, the garment with its recordings, recordings held out, the blind one, and sentences on what the files leave in doubt."""

    effects: tuple[Effect, ...]
    garment: Garment
    held_out: tuple[Recording, ...]
    blind: Recording | None
    warnings: tuple[str, ...]

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """All of them."""
        return (*self.garment.recordings, *self.held_out, *([self.blind] if self.blind else []))


def read(request: Request) -> Inputs:
    """What a request names. Raises BadInput with everything that is wrong with any of it.

    Recordings held out are read here too, for their faults; nothing else asks for them before the verdict is fixed.
    """
    faults, tracks, left_out = _faults(request), {}, ()
    known = library(request.plugins)
    with _collected(faults):
        left_out = named(request.without, known, "--without")
    for path in request.files:
        if path.exists():
            with _collected(faults):
                tracks[path] = read_tracked_geometry(path, fps=request.fps, up=request.up)
    refuse(faults)
    garment = _garment(request, tracks)
    held_out, blind = _further(request, tracks, garment)
    warnings = [w for p in request.files for w in tracks[p].warnings] + _chosen(garment, [tracks[p] for p in request.tracks])
    return Inputs(tuple(suspects(e for e in known.values() if e not in left_out)), garment, held_out, blind, tuple(warnings))


@contextmanager
def _collected(faults: list[Fault]) -> Iterator[None]:
    """Faults raised in the block are added, and it ends there."""
    try:
        yield
    except BadInput as bad:
        faults += bad.faults


def _garment(request: Request, tracks: dict[Path, TrackedGeometry]) -> Garment:
    """Raises BadInput with what is wrong with any file, by itself or beside the first."""
    names, found = list(dict.fromkeys(request.tracks)), []
    faults = [f for p in request.held_out for f in recording_faults(tracks[p], str(p), first=tracks[names[0]])]
    unseen = (tracks[request.predict], str(request.predict)) if request.predict else None
    with _collected(faults):
        found.append(garment_recordings([tracks[p] for p in names], [str(p) for p in names], blind=unseen))
    refuse(faults)
    return found[0]


def _further(request: Request, tracks: dict[Path, TrackedGeometry], garment: Garment) -> tuple[tuple[Recording, ...], Recording | None]:
    """Recordings held out, and the blind one. Raises BadInput where one does not say how the garment is driven."""
    faults: list[Fault] = []
    held_out, blind = [], None
    for path in request.held_out:
        with _collected(faults):
            held_out.append(recording(tracks[path], str(path), garment))
    if request.predict:
        with _collected(faults):
            blind = recording(tracks[request.predict], str(request.predict), garment, blind=True)
    refuse(faults)
    return tuple(held_out), blind


def _chosen(garment: Garment, tracks: Sequence[TrackedGeometry]) -> list[str]:
    """Of what was chosen for the garment, what a diagnosis rests on: how it is held, where no file says it, and what is doubtful."""
    told = any(len(track.boundary) for track in tracks)
    return [said for said in garment.chosen if said.startswith(("doubtful: ",) if told else ("boundary: ", "doubtful: "))]


def _faults(request: Request) -> list[Fault]:
    """What is wrong with the request, files unread."""
    faults = [
        Fault(str(p), "there is no such file or folder", "Give an NPZ of tracked geometry, or a folder of meshes.")
        for p in request.files
        if not p.exists()
    ]
    if not request.tracks:
        faults.append(Fault("gap run", "names no recording", "Give at least one NPZ or folder."))
    if (request.predict is None) != (request.out is None):
        faults.append(Fault("--predict and --out", "one is given without the other", "Give both."))
    faults += [] if request.out is None else _place_faults("--out", request.out)
    if request.report is not None and request.report.suffix != ".html":
        faults.append(Fault(f"--report {request.report}", "does not end in .html", "Name an HTML page; its JSON goes beside it."))
    return faults + ([] if request.report is None else _place_faults("--report", request.report))


def _place_faults(option: str, path: Path) -> list[Fault]:
    """Why no file can be put there."""
    if path.is_dir():
        return [Fault(f"{option} {path}", "is a folder", "Name a file in it.")]
    if not path.parent.is_dir():
        return [Fault(f"{option} {path}", "its folder does not exist", "Create it, or choose another.")]
    return []
