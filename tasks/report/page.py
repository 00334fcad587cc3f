"""The report: one self-contained HTML page, made of sections of text, tables and figures. Everything from outside is escaped."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Table:
    """Rows under named columns; numbers are set right with four digits, None and NaN are a dash."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Figure:
    """A picture as data URI with the sentence below it; `plot` gives it a white ground."""

    uri: str
    caption: str
    plot: bool = False


@dataclass(frozen=True)
class Section:
    """One heading and what stands below it; links: words and the bare name of a file beside the page."""

    heading: str
    paragraphs: Sequence[str] = ()
    links: Sequence[tuple[str, str]] = field(default=(), kw_only=True)
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    warnings: Sequence[str] = field(default=())


def page(title: str, subtitle: str, verdict: str, sections: Sequence[Section]) -> str:
    """The whole page as HTML."""
    from jinja2 import Environment

    template = Path(__file__).with_name("page.html.j2").read_text()
    return (
        Environment(autoescape=True, trim_blocks=True)
        .from_string(template)
        .render(title=title, subtitle=subtitle, verdict=verdict, sections=sections)
    )
