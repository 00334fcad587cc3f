"""Progress bars on stderr: one per stage, with the time that remains; and every warning of a stage."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from flows.runs import RunRecord


@contextmanager
def bars(record: RunRecord, console: Console) -> Iterator[None]:
    """Show the record as it changes; on a terminal as bars, elsewhere one line per ended stage. Each warning once, as it comes."""
    columns = (
        TextColumn("{task.description:<10}"),
        BarColumn(24),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[text]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        rows: dict[str, TaskID] = {}
        told: set[str] = set()
        warned: set[tuple[str, str]] = set()

        def listen(record: RunRecord) -> None:
            for name, entry in record.stages.items():
                if name not in rows:
                    rows[name] = progress.add_task(name, total=1.0, text="")
                progress.update(rows[name], completed=entry["fraction"], text=entry["text"] or entry["state"])
                for said in dict.fromkeys(said for said in entry["warnings"] if (name, said) not in warned):
                    warned.add((name, said))
                    console.print(f"{name}: {said}", style="yellow", markup=False, highlight=False, soft_wrap=True)
                if entry["state"] != "running" and name not in told:
                    told.add(name)
                    if not console.is_terminal:
                        console.print(f"{name:<10} {entry['state']:<10} {entry.get('seconds', 0.0):7.1f} s", highlight=False)

        record.listen = listen
        yield
