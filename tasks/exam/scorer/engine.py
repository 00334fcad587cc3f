"""Which cases of another engine count: nulls, and effects that exceed what the refitted base leaves over of that engine's own cloth.

Two engines differ without any cause. What a refit of the base leaves over on the engine's nulls is that difference; an effect that is not
twice as large might drown in it, and nobody is asked for it.
"""

from collections.abc import Hashable, Mapping
from typing import Any, TypeVar

import numpy as np

Case = TypeVar("Case", bound=Hashable)
TWICE = 2.0


def counted(rows: Mapping[Case, Mapping[str, Any]]) -> tuple[dict[Case, Any], float | None]:
    """The cases that count, and the median over nulls of what the refit leaves over [mm]; without a null no effect counts."""
    left = [row["before_mm"] for row in rows.values() if row["expected"] == "none" and row.get("before_mm") is not None]
    residual = float(np.median(left)) if left else None
    kept = {case: row for case, row in rows.items() if row["expected"] == "none" or _large(row["magnitude_mm"], residual)}
    return kept, residual


def _large(magnitude_mm: float, residual_mm: float | None) -> bool:
    return residual_mm is not None and magnitude_mm > TWICE * residual_mm


def heading(result: Mapping[str, Any]) -> str:
    """Whose cases these are, and which of them count."""
    if result["null_residual_mm"] is None and not result["too_small"]:
        whose = {"own": "of the generator", "pictures": "from images"}.get(result["engine"], f"of the {result['engine']} engine")
        return f"cases {whose}: {result['cases']}"
    left = "unknown" if result["null_residual_mm"] is None else f"{result['null_residual_mm']:.3g} mm"
    small = f"; smaller than twice that, and not counted: {result['too_small']}" if result["too_small"] else ""
    return f"cases of the {result['engine']} engine: {result['cases']} count; the refitted base misses its nulls by {left}{small}"
