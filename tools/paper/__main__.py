"""Regenerate every figure and table of docs/paper.md:  python tools/paper [PAGE ...]

Figures go to docs/images/paper, tables between their marks in docs/paper.md. Takes a few minutes.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable
from pathlib import Path

import commands
import drive41
import models
import vehicle42
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "paper.md"
IMAGES = ROOT / "docs" / "images" / "paper"

PAGES: dict[str, Callable[[], tuple[dict[str, Figure], str]]] = {
    "recirculation": models.recirculation,
    "open_loop": models.validation,
    "drive": drive41.drive,
    "gains": drive41.gains,
    "table1": drive41.table1,
    "variants": drive41.variants,
    "limits": drive41.limits,
    "cruise": drive41.cruise,
    "stiff_shafts": vehicle42.stiff_shafts,
    "vehicle": vehicle42.comparison,
}
COMMANDS: dict[str, Callable[[Path], str]] = {"design": commands.design, "studies": commands.studies}


def put(text: str, name: str, content: str) -> str:
    """Return a page with what stands between the marks of ``name`` replaced."""
    marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    if not marks.search(text):
        raise SystemExit(f"{PAGE}: the marks <!-- {name} --> and <!-- /{name} --> are missing")
    return marks.sub(lambda found: f"{found[1]}{content}\n{found[2]}", text)


def main(wanted: list[str]) -> None:
    if {"-h", "--help"} & set(wanted):
        raise SystemExit(__doc__)
    known = [*PAGES, *COMMANDS]
    unknown = sorted(set(wanted) - set(known))
    if unknown:
        raise SystemExit(f"unknown: {', '.join(unknown)}; there are: {', '.join(known)}")
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name in wanted or known:
        start = time.monotonic()
        if name in COMMANDS:
            content = COMMANDS[name](IMAGES)
        else:
            figures, content = PAGES[name]()
            for image, figure in figures.items():
                figure.savefig(IMAGES / f"{image}.png")
        if content:
            print(f"\n{content}")
            PAGE.write_text(put(PAGE.read_text(encoding="utf-8"), name, content), encoding="utf-8")
        print(f"{name}: {time.monotonic() - start:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
