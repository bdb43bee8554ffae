"""The picture of `equal_time.py`: gains of every scene on a logarithmic axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

# Drawn larger by this factor, then reduced.
FINER = 2
PANEL, LABELS, ROW, HEAD, FOOT, GAP = 360, 140, 24, 62, 30, 28
LOW, HIGH = 0.05, 100.0
TICKS = (0.1, 1.0, 2.0, 10.0)
STATISTICS = ("median", "mean", "90 %", "99 %")
# Distinct for the colour-blind.
COLORS = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 60, 0))
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
GREY, DARK = (190, 190, 190), (40, 40, 40)


@dataclass(frozen=True)
class Panel:
    """A title, the one whose image is cleaner above 1, and the gains of each scene: median, mean, 90 % and 99 % quantile."""

    title: str
    better: str
    gains: dict[str, np.ndarray]


def draw(rows: list[list[Panel]], path: Path) -> None:
    """Panels in rows and columns, written as PNG. The panels of a row have the same scenes."""
    block = [HEAD + ROW * len(row[0].gains) + FOOT for row in rows]
    columns = max(len(row) for row in rows)
    width, height = LABELS + columns * (PANEL + GAP), sum(block)
    image = Image.new("RGB", (width * FINER, height * FINER), "white")
    pen = ImageDraw.Draw(image)
    small, large = (ImageFont.load_default(size * FINER) for size in (13, 15))
    top = 0
    for row, tall in zip(rows, block):
        for k, panel in enumerate(row):
            _panel(pen, panel, LABELS + k * (PANEL + GAP), top, k == 0, small, large)
        top += tall
    reduced = image.resize((width, height), Image.Resampling.LANCZOS)
    reduced.quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)


def _panel(pen: ImageDraw.ImageDraw, panel: Panel, left: int, top: int, is_first: bool, small: Font, large: Font) -> None:
    def place(gain: float) -> float:
        share = math.log(gain / LOW) / math.log(HIGH / LOW)
        return left + PANEL * min(max(share, 0.0), 1.0)

    def text(x: float, y: float, words: str, font: Font, anchor: str, fill: tuple[int, int, int] = DARK) -> None:
        pen.text((x * FINER, y * FINER), words, font=font, anchor=anchor, fill=fill)

    def line(x0: float, y0: float, x1: float, y1: float, fill: tuple[int, int, int], width: int = 1) -> None:
        pen.line([v * FINER for v in (x0, y0, x1, y1)], fill=fill, width=width * FINER)

    first = top + HEAD
    last = first + ROW * len(panel.gains)
    text(left, top + 16, panel.title, large, "lm")
    x = float(left)
    for k, name in enumerate(STATISTICS):
        _mark(pen, x + 6, top + 40, k)
        text(x + 16, top + 40, name, small, "lm")
        x += 78
    pen.rectangle([v * FINER for v in (left, first, left + PANEL, last)], outline=GREY, width=FINER)
    for tick in TICKS:
        is_bar = tick in (1.0, 2.0)
        line(place(tick), first, place(tick), last, DARK if is_bar else GREY, 2 if tick == 1.0 else 1)
        text(place(tick), last + 4, f"{tick:g}", small, "mt")
    text(left + PANEL, last + 4, f"{panel.better} cleaner", small, "rt")
    for number, (scene, gains) in enumerate(panel.gains.items()):
        y = first + ROW * (number + 0.5)
        if number:
            line(left, y - 0.5 * ROW, left + PANEL, y - 0.5 * ROW, (235, 235, 235))
        if is_first:
            text(left - 8, y, scene, small, "rm")
        for k, gain in enumerate(gains):
            if gain > 0.0:
                # Each quantity has a line of its own, so that marks of equal gains do not cover each other.
                _mark(pen, place(float(gain)), y + 5.0 * (k - 1.5), k)


def _mark(pen: ImageDraw.ImageDraw, x: float, y: float, number: int) -> None:
    """A disc, a square, a triangle or a diamond."""
    r, color = 3.6, COLORS[number]
    corners = {
        1: [(-r, -r), (r, -r), (r, r), (-r, r)],
        2: [(-r - 0.6, r), (r + 0.6, r), (0.0, -r - 0.6)],
        3: [(-r - 1.0, 0.0), (0.0, -r - 1.0), (r + 1.0, 0.0), (0.0, r + 1.0)],
    }
    if number in corners:
        pen.polygon([((x + a) * FINER, (y + b) * FINER) for a, b in corners[number]], fill=color)
    else:
        pen.ellipse([v * FINER for v in (x - r, y - r, x + r, y + r)], fill=color)
