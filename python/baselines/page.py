"""docs/baselines.md and its picture from the committed results.

    python3 -m baselines.page

in `python/`; needs NumPy only. Runs that are not finished are left out, and the page says which.
"""

from __future__ import annotations

import json
import statistics
from pathlib import Path

import numpy as np

from . import files, picture, settings
from .settings import RESULTS, ROOT, SEEDS, VARIANTS, Variant

PAGE, PICTURE = ROOT / "docs/baselines.md", ROOT / "docs/pictures/baselines.svg"
GRID = np.arange(1, 41) * (settings.STEPS // 40)
"""Steps at which curves of runs with other updates are compared."""

MEASURES = {"return": "return", "length": "length of an episode, s", "error_xy_mps": "error of the velocity, m/s"}


class Curves:
    """The finished runs of a variant: `values[measure]` has a row for each seed on `GRID`."""

    def __init__(self, variant: Variant, results: Path = RESULTS) -> None:
        self.variant = variant
        found = [seed for seed in SEEDS if (results / f"{variant.name}-{seed}.json").exists()]
        self.missing = [seed for seed in SEEDS if seed not in found]
        tables = [files.read_curve(results / f"{variant.name}-{seed}.csv") for seed in found]
        self.values = {measure: np.array([_on_grid(table, measure) for table in tables]) for measure in MEASURES}
        self.values["length"] = self.values["length"] / settings.task()["engine"]["control_hz"]
        summaries = [json.loads((results / f"{variant.name}-{seed}.json").read_text()) for seed in found]
        self.processor = [1e6 * summary["processor_seconds"] / summary["steps"] for summary in summaries]

    def at(self, measure: str, steps: int, digits: int) -> str:
        """Mean and range over the seeds."""
        column = self.values[measure][:, np.searchsorted(GRID, steps)]
        return f"{column.mean():.{digits}f} ({column.min():.{digits}f} to {column.max():.{digits}f})"


def _on_grid(table: list[list[str]], measure: str) -> np.ndarray:
    """A curve at the steps of `GRID`."""
    column = files.COLUMNS.index(measure)
    known = [(float(row[0]), float(row[column])) for row in table if row[column] != ""]
    steps, values = np.array(known).T
    return np.interp(GRID, steps, values, left=np.nan)


def rates() -> dict[str, list[float]]:
    """The measured steps a second by name."""
    return json.loads((RESULTS / "throughput.json").read_text())["steps_per_second"]


def throughput(found: dict[str, list[float]]) -> str:
    """Table (a), and what it says of the target."""
    titles = {variant.name: variant.title for variant in VARIANTS}
    titles |= {"omniwalk-rapier": "omniwalk, engine rapier", "sb3-rapier-ours": "SB3 in our environment, engine rapier, our hyper-parameters"}
    medians = {name: statistics.median(values) for name, values in found.items()}
    theirs = max(medians[name] for name in ("sb3-mujoco-ours", "sb3-mujoco-recommended"))
    lines = ["| | steps/s, median (range) | over the faster of SB3 in MuJoCo |", "|---|---|---|"]
    for name, median in sorted(medians.items(), key=lambda entry: -entry[1]):
        values = found[name]
        spread = f"{min(values):,.0f} to {max(values):,.0f}"
        lines.append(f"| {titles[name]} | {median:,.0f} ({spread}) | {median / theirs:.1f} |")
    factor = medians["omniwalk"] / theirs
    verdict = "met" if factor >= 10.0 else "**missed**"
    lines += ["", f"The target, ten times SB3 in MuJoCo, is {verdict}: {factor:.1f} times. With rapier it is "
              f"{medians['omniwalk-rapier'] / theirs:.1f} times."]
    return "\n".join(lines)


def efficiency(curves: dict[str, Curves]) -> str:
    """Table (b), and what it says of the target."""
    lines = ["| | return at 1 M | return at 2 M | length at 2 M, s | error at 2 M, m/s | least processor s per million steps |", "|---|---|---|---|---|---|"]
    for name, found in curves.items():
        if not len(found.values["return"]):
            continue
        figures = [found.at("return", 1_000_000, 0), found.at("return", 2_000_000, 0), found.at("length", 2_000_000, 1)]
        figures += [found.at("error_xy_mps", 2_000_000, 3), f"{min(found.processor):.0f}"]
        mark = " [1]" if name == "omniwalk" else ""
        lines.append(f"| {found.variant.title}{mark} | " + " | ".join(figures) + " |")
    pair = [curves[name].values["return"] for name in ("omniwalk-equal", "sb3-lanes-ours")]
    if all(len(values) for values in pair):
        area = [np.nanmean(values, axis=1) for values in pair]
        verdict = "met" if area[0].mean() >= area[1].mean() else "**missed**"
        figures = [f"{values.mean():.0f} ({values.min():.0f} to {values.max():.0f})" for values in area]
        ours, theirs = (values.mean(axis=0) for values in pair)
        behind = [f"{steps / 1e6:g}" for steps, one, other in zip(GRID, ours, theirs) if one < other]
        where = f"their mean is ahead at {', '.join(behind)} M steps" if behind else "their mean is ahead nowhere"
        lines += ["", f"The target, a sample efficiency no worse than SB3's under the settings both have in the same environment, is {verdict}: the return averaged "
                  f"over the {settings.STEPS / 1e6:g} M steps is {figures[0]}, theirs {figures[1]}; {where}."]
    missing = {found.variant.title: found.missing for found in curves.values() if found.missing}
    if missing:
        entries = "; ".join(f"{title}: seed {', '.join(map(str, seeds))}" for title, seeds in missing.items())
        lines += ["", f"Not finished yet, and not in the figures: {entries}."]
    return "\n".join(lines)


def draw(curves: dict[str, Curves], found: dict[str, list[float]]) -> str:
    """The picture: each measure against steps and against wall time."""
    shown = [(entry, picture.COLOURS[k]) for k, entry in enumerate(curves.values()) if len(entry.values["return"])]
    rows = []
    for measure, title in MEASURES.items():
        steps = [picture.Band(GRID / 1e6, entry.values[measure], colour) for entry, colour in shown]
        minutes = [
            picture.Band(GRID / statistics.median(found[entry.variant.name]) / 60.0, entry.values[measure], colour) for entry, colour in shown
        ]
        rows.append([picture.Panel(title, "million steps", steps, False), picture.Panel(title, "minutes", minutes, True)])
    return picture.grid(rows, [(colour, entry.variant.title) for entry, colour in shown])


def main() -> None:
    """Writes page and picture."""
    curves, found = {variant.name: Curves(variant) for variant in VARIANTS}, rates()
    files.write(PICTURE, draw(curves, found))
    text = (Path(__file__).parent / "page.md").read_text()
    files.write(PAGE, text.replace("{throughput}", throughput(found)).replace("{efficiency}", efficiency(curves)))


if __name__ == "__main__":
    main()
