"""Knitted strips: the clamped strip is simulated, the material fitted on repeats 1–3, the error reported on repeats 4 and 5.

    python -m tests.benchmarks.knit          QUICK=1: one fabric          JSON=1: JSON on stdout

Beside each figure the curve fit of the same freedom (least squares on the curves, no strip): one or two laws, linear or with e³ and e⁵.
"""

import json
import os
import sys
import time

import numpy as np

from tests.real.knit_strips import FABRICS, Knit, fitted, folder, measured_ratio, read, rms, stiffness_ratio, stretch

MODELS = {  # name: (orthotropic, stiffening)
    "isotropic": (False, False),
    "stiffening": (False, True),
    "orthotropic": (True, False),
    "orthotropic and stiffening": (True, True),
}


def curve_fit(fabric: str, *, orthotropic: bool, stiffening: bool) -> float:
    """Held-out rms [N/m] of least squares on the curves themselves."""
    powers = (1, 3, 5) if stiffening else (1,)
    pulls = [read(fabric, d) for d in "xy"]
    design = lambda e: np.stack([e**p for p in powers], 1)  # noqa: E731
    joined = lambda part: [np.concatenate([getattr(p, part)[k] for p in pulls]) for k in (0, 1)]  # noqa: E731
    groups = [(p.train, p.test) for p in pulls] if orthotropic else [(joined("train"), joined("test"))]
    errors = []
    for (e, q), (e_test, q_test) in groups:
        errors.append(design(e_test) @ np.linalg.lstsq(design(e), q, rcond=None)[0] - q_test)
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def main() -> None:
    """Print the table."""
    if not folder().is_dir():
        sys.exit(f"the recordings are not at {folder()}; set PHYSAVATAR_REAL_DATA")
    clock, table = time.process_time(), []
    for fabric in FABRICS[: 1 if os.environ.get("QUICK") else None]:
        for name, (orthotropic, stiffening) in MODELS.items():
            knit = fitted(fabric, orthotropic=orthotropic, stiffening=stiffening)
            table.append(
                {
                    "fabric": fabric,
                    "model": name,
                    "stretch_N_per_m": stretch(knit, fabric),
                    "orthotropy": knit.orthotropy,
                    "stiffening": knit.stiffening,
                    "simulated_N_per_m": rms(knit, fabric, "test"),
                    "curve_fit_N_per_m": curve_fit(fabric, orthotropic=orthotropic, stiffening=stiffening),
                }
            )
        contraction = float(np.mean([read(fabric, d).contraction for d in "xy"]))
        ratio = {"measured": measured_ratio(fabric)}
        ratio |= {f"isotropic, ν {ν:.2g}": stiffness_ratio(fabric, Knit(poisson=ν)) for ν in (Knit().poisson, contraction)}
        table.append({"fabric": fabric, "stiffness X over Y to 15 %": ratio})
    if os.environ.get("JSON"):
        json.dump({"rows": table, "cpu_seconds": time.process_time() - clock}, sys.stdout, indent=1)
        return
    print("fabric | model | E t [N/m] | a | c | simulated strip | curve fit   [held-out rms, N/m]")
    for row in table:
        if "model" in row:
            values = [row[k] for k in ("stretch_N_per_m", "orthotropy", "stiffening", "simulated_N_per_m", "curve_fit_N_per_m")]
            print(f"{row['fabric']} | {row['model']} | " + " | ".join(f"{v:.3g}" for v in values))
        else:
            print(
                f"{row['fabric']} | stiffness X over Y to 15 %: "
                + ", ".join(f"{k} {v:.2f}" for k, v in row["stiffness X over Y to 15 %"].items())
            )
    for name in MODELS:
        rows = [row for row in table if row.get("model") == name]
        mean = [np.mean([row[k] for row in rows]) for k in ("simulated_N_per_m", "curve_fit_N_per_m")]
        print(f"mean | {name} | simulated {mean[0]:.1f}, curve fit {mean[1]:.1f}")
    print(f"{time.process_time() - clock:.0f} CPU s")


if __name__ == "__main__":
    main()
