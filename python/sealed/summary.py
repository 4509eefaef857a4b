"""Compares results with truths: who was named, false alarms, parameters, errors."""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from .cases import ensure

OPEN = 1.5
"""Where re-tuning leaves less than so many times the floor, it explains what is wrong, and there is no gap to close."""

WIDTHS = (0.5, 0.75, 1.0, 1.5, 2.0)
"""Multiples of an interval's half width within which numbers are counted."""


@dataclass
class Outcome:
    """A case with what was said of it."""

    name: str
    kind: str
    effects: list[dict]
    leading: list[str]
    floor: float
    report: dict
    accepted: list[str] = field(default_factory=list)
    sets: list[list[str]] = field(default_factory=list)

    @property
    def machine(self) -> str:
        return self.name.partition("-")[0]

    @property
    def verdict(self) -> str:
        return self.report.get("verdict", "no_report")

    @property
    def truth(self) -> set[str]:
        return {effect["name"] for effect in self.effects}

    @property
    def label(self) -> str:
        """What was answered, in one word."""
        short = {"no_missing_effect": "nothing", "insufficient_data": "refused"}
        if self.verdict not in ("explained", "indistinguishable", "unexplained"):
            return short.get(self.verdict, self.verdict)
        named = self.accepted + ["/".join(sorted(names)) for names in self.sets if not set(names) & set(self.accepted)]
        named += ["unexplained"] if self.verdict == "unexplained" else []
        return " + ".join(sorted(named)) or self.verdict

    def named(self) -> bool:
        """Whether each true effect was accepted, or is in a set that was named."""
        return all(name in self.accepted or any(name in names for names in self.sets) for name in self.truth)

    def right(self) -> bool:
        """Whether no wrong name, and no set without a right one, stands beside those."""
        right = [names for names in self.sets if self.truth & set(names)]
        alone = [name for name in self.accepted if name not in self.truth and not any(name in names for names in right)]
        return self.named() and not alone and len(right) == len(self.sets) and self.at_its_place()

    def at_its_place(self) -> bool:
        """Whether what was accepted by a true name is said of a joint or link that lacks it."""
        lacking = {(effect["name"], effect["joint"]) for effect in self.effects}
        said = [(entry["effect"], entry["target"]) for entry in self.report.get("accepted", [])]
        return all(own in lacking for own in said if own[0] in self.truth)

    def alone(self) -> bool:
        """Whether it is right without a set of what cannot be told apart."""
        return self.right() and not self.sets

    def exact(self) -> bool:
        """Whether, beyond that, nothing is said to be left."""
        return self.right() and self.verdict != "unexplained"

    def led(self) -> bool:
        """Whether the first variable of what is left is a right one, of the right joint where it says of which."""
        variable, _, joint = (self.report.get("unexplained", {}).get("depends_on") or [""])[0].partition(" of ")
        return variable in self.leading and joint in ("", *(effect["joint"] for effect in self.effects))

    def heldout(self, which: str) -> float:
        """Root mean square error of joint positions on held-out logs, rad."""
        value = self.report.get(which, {}).get("heldout", {}).get("rmse", {}).get("overall")
        return math.nan if value is None else float(value)

    def gap_closed(self) -> float:
        """Share of the re-tuned model's error above the true floor that is gone; not a number where there is no gap."""
        refit, last = self.heldout("refit"), self.heldout("final")
        return (refit - last) / (refit - self.floor) if refit > OPEN * self.floor else math.nan


def load(out: Path, results: Path) -> list[Outcome]:
    """Every result with its truth; a case that is not under `out` is made again."""
    return [_outcome(path, out) for path in sorted(results.glob("*.json"))]


def _outcome(path: Path, out: Path) -> Outcome:
    machine, _, seed = path.stem.rpartition("-")
    ensure(machine, int(seed), out)
    truth = json.loads((out / "truth" / path.name).read_text())
    report = json.loads(path.read_text())["report"]
    squares = [
        value**2 for log, joints in truth["floor"].items() if log.startswith("heldout/") for value in joints.values()
    ]
    names = [_names(entry) for entry in report.get("indistinguishable", [])]
    case = truth["case"]
    return Outcome(
        *(path.stem, case["kind"], case["effects"], case["leading"], math.sqrt(sum(squares) / len(squares)), report),
        accepted=[entry["effect"] for entry in report.get("accepted", [])],
        sets=names,
    )


def _names(entry) -> list[str]:
    """The effects of a set, which may be names or tables with a name, with or without a target behind."""
    names = [item["effect"] if isinstance(item, dict) else item for item in entry]
    return [name.split()[0].split("@")[0].split(":")[0] for name in names]


def true_parameters(effect: dict) -> dict[str, float]:
    """The true values in the terms of reports."""
    values = dict(effect["parameters"])
    if effect["name"] == "position_ripple":
        amplitude, phase = values.pop("amplitude"), values.pop("phase")
        values |= {"sine": amplitude * math.cos(phase), "cosine": amplitude * math.sin(phase)}
    return values


def parameters(outcome: Outcome) -> list[tuple[str, str, float, float, float | None]]:
    """Effect, parameter, truth, estimate and how far apart they are in half widths of its interval, of what was rightly accepted."""
    rows = []
    for effect in outcome.effects:
        for entry in outcome.report.get("accepted", []):
            if (entry["effect"], entry["target"]) != (effect["name"], effect["joint"]):
                continue
            estimates = entry["parameters"]
            for key, true in true_parameters(effect).items():
                factor = 1.0
                if effect["name"] == "supply_voltage":
                    key, factor = "actual", 1.0 / estimates.get("nominal", {"value": 1.0})["value"]
                if key in estimates:
                    interval = estimates[key].get("ci95")
                    estimate = estimates[key]["value"] * factor
                    half = interval and 0.5 * (interval[1] - interval[0]) * factor
                    rows.append((effect["name"], key, true, estimate, abs(estimate - true) / half if half else None))
    return rows


def tables(outcomes: list[Outcome]) -> str:
    """Everything as Markdown."""
    parts = [_targets(outcomes), _confusion(outcomes), _parameters(outcomes), _errors(outcomes)]
    return "\n".join(parts)


def _share(hits: int, count: int) -> str:
    return f"{hits} of {count} ({100 * hits / count:.0f} %)" if count else "no cases"


def _targets(outcomes: list[Outcome]) -> str:
    """The figures to reach, of all cases and of each machine's."""
    machines = sorted({outcome.machine for outcome in outcomes})
    groups = [[outcome for outcome in outcomes if outcome.machine == machine] for machine in machines]
    heads = [f"{machine} ({len(group)})" for machine, group in zip(machines, groups)]
    columns = [_figures(group) for group in (outcomes, *(groups if len(groups) > 1 else []))]
    lines = [
        f"| figure | {' | '.join([f'all ({len(outcomes)})', *heads][: len(columns)])} | to reach |",
        "|" + "---|" * (len(columns) + 2),
    ]
    for rows in zip(*columns):
        name, _, goal = rows[0]
        lines.append(f"| {name} | {' | '.join(value for _, value, _ in rows)} | {goal} |")
    return "\n".join(lines) + "\n"


def _figures(outcomes: list[Outcome]) -> list[tuple[str, str, str]]:
    """What is counted, how it is, and what the procedure is to reach."""
    of = lambda *kinds: [outcome for outcome in outcomes if outcome.kind in kinds]
    none, single, pair, outside = of("none"), of("single"), of("pair"), of("outside")
    held = [row[4] <= 1.0 for outcome in outcomes for row in parameters(outcome) if row[4] is not None]
    led = [outcome for outcome in outside if outcome.verdict == "unexplained" and outcome.led()]
    closed = lambda cases: [share for share in (case.gap_closed() for case in cases) if not math.isnan(share)]
    inside_closed, outside_closed = closed(single + pair), closed(outside)
    median_of = lambda shares: f"{round(100 * median(shares))} %" if shares else "no cases"
    return [
        ("single: right name, no wrong one", _share(sum(o.right() for o in single), len(single)), "90 %"),
        ("... named alone, not in a set", _share(sum(o.alone() for o in single), len(single)), ""),
        ("... and nothing is said to be left", _share(sum(o.exact() for o in single), len(single)), ""),
        ("pair: both right names, no wrong one", _share(sum(o.right() for o in pair), len(pair)), ""),
        ("none: false alarms", _share(sum(o.verdict != "no_missing_effect" for o in none), len(none)), "at most 5 %"),
        ("outside: `unexplained`", _share(sum(o.verdict == "unexplained" for o in outside), len(outside)), ""),
        ("outside: and the right leading variable", _share(len(led), len(outside)), "80 %"),
        ("95 % intervals that hold the truth", _share(sum(held), len(held)), "90 to 99 %"),
        ("gap closed, effect in the library, median", median_of(inside_closed), "80 %"),
        ("... at least 80 %", _share(sum(share >= 0.8 for share in inside_closed), len(inside_closed)), ""),
        ("gap closed, outside effect, median", median_of(outside_closed), "60 %"),
        ("... at least 60 %", _share(sum(share >= 0.6 for share in outside_closed), len(outside_closed)), ""),
    ]


def _confusion(outcomes: list[Outcome]) -> str:
    answers: dict[str, Counter] = defaultdict(Counter)
    for outcome in outcomes:
        answers[" + ".join(sorted(outcome.truth)) or "(none)"][outcome.label] += 1
    lines = ["| truth | said (times) |", "|---|---|"]
    for truth, counts in sorted(answers.items()):
        said = ", ".join(f"{label} ({count})" for label, count in counts.most_common())
        lines.append(f"| {truth} | {said} |")
    return "\n".join(lines) + "\n"


def _parameters(outcomes: list[Outcome]) -> str:
    by_name: dict[tuple[str, str], list] = defaultdict(list)
    for outcome in outcomes:
        for name, key, true, estimate, distance in parameters(outcome):
            by_name[name, key].append((abs(estimate - true) / abs(true), distance))
    lines = ["| effect | parameter | cases | median error | intervals that hold the truth |", "|---|---|---|---|---|"]
    for (name, key), rows in sorted(by_name.items()):
        held = [distance <= 1.0 for _, distance in rows if distance is not None]
        error = 100 * median(error for error, _ in rows)
        lines.append(f"| {name} | {key} | {len(rows)} | {error:.1f} % | {_share(sum(held), len(held))} |")
    distances = [distance for rows in by_name.values() for _, distance in rows if distance is not None]
    within = [f"{sum(distance <= widths for distance in distances)} within {widths}" for widths in WIDTHS]
    lines += ["", f"Of {len(distances)} numbers the truth is, in half widths of their intervals, of {', '.join(within)}."]
    return "\n".join(lines) + "\n"


def _errors(outcomes: list[Outcome]) -> str:
    """Medians over the cases to which every effect at once was fitted, or over all where it was to none."""
    columns = ["nominal", "refit", "all_effects", "final"]
    compared = [outcome for outcome in outcomes if not math.isnan(outcome.heldout("all_effects"))]
    outcomes = compared or outcomes
    lines = ["| cases | nominal | re-tuned | all effects at once | final | floor |", "|---|---|---|---|---|---|"]
    for kind in ("none", "single", "pair", "outside"):
        cases = [outcome for outcome in outcomes if outcome.kind == kind]
        cells = []
        for values in ([case.heldout(column) for case in cases] for column in columns):
            known = [value for value in values if not math.isnan(value)]
            cells.append(f"{1000 * median(known):.2f}" if known else "-")
        floor = f"{1000 * median(case.floor for case in cases):.2f}" if cases else "-"
        lines.append(f"| {kind} ({len(cases)}) | {' | '.join(cells)} | {floor} |")
    return "Median held-out error of joint positions, mrad:\n\n" + "\n".join(lines) + "\n"
