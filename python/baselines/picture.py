"""Learning curves as a picture: a line for the mean over seeds, a band from the lowest to the highest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies.common import svg

WIDTH, HEIGHT, MARGIN = 400, 220, 56
COLOURS = ["#1b6ca8", "#7fb2d6", "#c8501e", "#e8a07c", "#3c7a3a", "#9bc48f"]


@dataclass
class Band:
    """A line of a panel: `x` and of each seed `values`, a row each, which may be short."""

    x: np.ndarray
    values: np.ndarray
    colour: str


@dataclass
class Panel:
    """One diagram; `log` puts its x axis on a logarithmic scale."""

    title: str
    x_label: str
    bands: list[Band]
    log: bool


def grid(panels: list[list[Panel]], legend: list[tuple[str, str]]) -> str:
    """Panels in rows, and above them what colour is whose."""
    parts, top = [], 20 * math.ceil(len(legend) / 2) + 16
    for k, (colour, name) in enumerate(legend):
        x, y = 16 + (k % 2) * (WIDTH + 20), 18 + 20 * (k // 2)
        parts.append(f'<rect x="{x}" y="{y - 8}" width="24" height="8" fill="{colour}"/>')
        parts.append(f'<text x="{x + 32}" y="{y}">{name}</text>')
    for row, line in enumerate(panels):
        for column, panel in enumerate(line):
            parts.append(f'<g transform="translate({column * (WIDTH + 20)},{top + row * (HEIGHT + 20)})">{_panel(panel)}</g>')
    return svg(2 * (WIDTH + 20), top + len(panels) * (HEIGHT + 20), parts)


def _panel(panel: Panel) -> str:
    at = np.log10 if panel.log else np.asarray
    xs = np.concatenate([at(band.x) for band in panel.bands])
    ys = np.concatenate([band.values[np.isfinite(band.values)] for band in panel.bands])
    left, right = float(xs.min()), float(xs.max())
    low, high = min(0.0, float(ys.min())), float(ys.max())
    across = lambda x: MARGIN + (at(x) - left) / (right - left) * (WIDTH - MARGIN - 8)
    down = lambda y: HEIGHT - 40 - (y - low) / (high - low) * (HEIGHT - 64)
    parts = [f'<text x="{MARGIN}" y="14" font-weight="bold">{panel.title}</text>']
    parts += [f'<text x="{WIDTH / 2}" y="{HEIGHT - 6}" text-anchor="middle">{panel.x_label}</text>']
    for tick in _ticks(low, high):
        y = down(tick)
        parts.append(f'<line x1="{MARGIN}" x2="{WIDTH - 8}" y1="{y:.1f}" y2="{y:.1f}" stroke="#dddddd"/>')
        parts.append(f'<text x="{MARGIN - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    steps = [10.0**k for k in range(math.ceil(left), math.floor(right) + 1)] if panel.log else _ticks(left, right)
    for tick in steps:
        x = float(across(tick))
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{HEIGHT - 40}" y2="{HEIGHT - 36}" stroke="black"/>')
        parts.append(f'<text x="{x:.1f}" y="{HEIGHT - 24}" text-anchor="middle">{tick:g}</text>')
    for band in panel.bands:
        known = np.isfinite(band.values).any(axis=0)
        x, values = across(band.x[known]), band.values[:, known]
        lower, upper, mean = (down(of(values, axis=0)) for of in (np.nanmin, np.nanmax, np.nanmean))
        outline = [*zip(x, lower), *zip(x[::-1], upper[::-1])]
        parts.append(f'<polygon points="{_points(outline)}" fill="{band.colour}" opacity="0.2"/>')
        parts.append(f'<polyline points="{_points(zip(x, mean))}" fill="none" stroke="{band.colour}" stroke-width="1.6"/>')
    return "".join(parts)


def _points(places) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def _ticks(low: float, high: float) -> list[float]:
    """Four or so round numbers."""
    raw = (high - low) / 4.0
    power = 10.0 ** math.floor(math.log10(raw))
    step = power * min((1, 2, 5, 10), key=lambda factor: abs(factor * power - raw))
    return [round(k * step, 10) for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
