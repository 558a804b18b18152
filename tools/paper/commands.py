"""Pages that a subcommand of dctorque gives: the design of section 3's gains, and the robustness studies."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from cases import CARS, table

TORQUES = {"clutch1_nm": "clutch 1", "clutch2_nm": "clutch 2", "output_nm": "output shaft"}
LARGEST = 3


def dctorque(*words: str) -> None:
    """Run a subcommand; what it says on stderr is shown."""
    subprocess.run([sys.executable, "-m", "dctorque_can.cli", *words], check=True, stdout=subprocess.DEVNULL)


def design(images: Path) -> str:
    """Draw noise against lag of the paper car's gains."""
    dctorque("design", "paper_car", "-o", str(images / "design.png"))
    return ""


def studies(images: Path) -> str:
    """Run both shipped studies."""
    rows = []
    for name, label in CARS.items():
        with tempfile.TemporaryDirectory() as folder:
            dctorque("study", name, "-o", folder)
            shutil.copyfile(Path(folder) / "sensitivity.png", images / f"study_{name}.png")
            summary = json.loads((Path(folder) / "summary.json").read_text(encoding="utf-8"))
        for torque, word in TORQUES.items():
            spread = summary["rms"][torque]
            ranking = [one for one in summary["sensitivity"][torque]["ranking"] if one["significant"]]
            named = [f"{one['factor']} {one['change_nm']:.1f}{one['shape']}" for one in ranking[:LARGEST]]
            numbers = (summary["nominal_rms"][torque], spread["p5"], spread["p50"], spread["p95"])
            explained = f"{100 * summary['sensitivity'][torque]['explained']:.0f} %"
            rows.append(
                [
                    f"{label}, {word}",
                    *(f"{x:.1f}" for x in numbers),
                    explained,
                    ", ".join(named) or "none above chance",
                ]
            )
    head = ["RMS error [N·m]", "nominal", "5 %", "median", "95 %", "explained"]
    return table([*head, "largest factors: change over the middle 90 % of their draws [N·m]"], rows)
