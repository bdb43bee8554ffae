"""Scenes as tables of HTML, for notebooks."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ._native import Scene

# Names and hazards of a kind that are shown.
_MOST = 12


def _listed(lines: Iterable[str]) -> str:
    every = [escape(line) for line in lines]
    shown, more = every[:_MOST], len(every) - _MOST
    if more > 0:
        shown.append(f"<i>and {more} more</i>")
    return "<br>".join(shown)


def _light(light: dict[str, Any]) -> str:
    watts = light.get("watts")
    power = f", {watts:.3g} W" if isinstance(watts, int | float) else ""
    return f"{light['name']} ({light['kind']}{power})"


def scene_html(scene: Scene) -> str:
    """A table: numbers and names of objects, materials, lights and cameras, and the hazards."""
    found = scene.inspect()
    objects, materials = found["object_list"], found["materials"]
    lights, cameras, hazards = found["lights"], found["cameras"], found["hazards"]
    rows = [
        ("Objects", len(objects), [f"{o['name']} ({o['triangles']:,} triangles)" for o in objects]),
        ("Materials", len(materials), [f"{m['name']}: {m['description']}" for m in materials]),
        ("Lights", len(lights), [_light(light) for light in lights]),
        ("Cameras", len(cameras), [f"{c['name']}: {c['description']}" for c in cameras]),
        ("Hazards", len(hazards), hazards),
    ]
    cell = 'style="text-align:left;vertical-align:top"'
    body = "".join(
        f"<tr><th {cell}>{title}</th><td {cell}>{number:,}</td><td {cell}>{_listed(lines)}</td></tr>"
        for title, number, lines in rows
    )
    caption = f'<caption style="text-align:left">{escape(repr(scene))}</caption>'
    return f"<table>{caption}<tbody>{body}</tbody></table>"
