"""Draw coordinates, angles and signs: ``python docs/make_drawing.py``.

What it shows are the conventions of the shipped models; a test holds it against them.
"""

from __future__ import annotations

import math
from pathlib import Path

INK, SOFT, BLUE, RED = "#202124", "#9aa0a6", "#0072b2", "#d55e00"


def line(x1: float, y1: float, x2: float, y2: float, colour: str = INK, *, arrow: bool = True,
         dash: str = "", width: float = 1.6) -> str:  # fmt: skip
    """Return a line, with a head where it is an arrow."""
    end = f' marker-end="url(#head-{colour[1:]})"' if arrow else ""
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    return (
        f'<line x1="{x1:g}" y1="{y1:g}" x2="{x2:g}" y2="{y2:g}" stroke="{colour}" '
        f'stroke-width="{width:g}"{dashes}{end}/>'
    )


def text(x: float, y: float, words: str, colour: str = INK, anchor: str = "middle") -> str:
    """Return a text."""
    return f'<text x="{x:g}" y="{y:g}" fill="{colour}" text-anchor="{anchor}">{words}</text>'


def arc(x: float, y: float, r: float, start: float, end: float, colour: str) -> str:
    """Return an arc with a head, from one angle to another in degrees, anticlockwise."""
    points = [(x + r * math.cos(math.radians(a)), y - r * math.sin(math.radians(a)))
              for a in (start, end)]  # fmt: skip
    (x1, y1), (x2, y2) = points
    large = int(abs(end - start) > 180)
    return (
        f'<path d="M {x1:.4g} {y1:.4g} A {r:g} {r:g} 0 {large} 0 {x2:.4g} {y2:.4g}" fill="none" '
        f'stroke="{colour}" stroke-width="1.6" marker-end="url(#head-{colour[1:]})"/>'
    )


def box(x: float, y: float, width: float, height: float, fill: str) -> str:
    """Return a filled rectangle about a centre."""
    return (
        f'<rect x="{x - width / 2:g}" y="{y - height / 2:g}" width="{width:g}" '
        f'height="{height:g}" fill="{fill}" stroke="{INK}"/>'
    )


def side() -> list[str]:
    """Return the rotor seen from the side, z to the right and x up."""
    y = 150
    parts = [text(250, 24, "from the side (y towards you)")]
    parts += [box(250, y, 400, 14, "#dadce0"), box(250, y, 34, 120, "#dadce0")]
    for x, name in ((100, "a"), (400, "b")):
        parts += [box(x, y - 34, 46, 26, "#f1f3f4"), box(x, y + 34, 46, 26, "#f1f3f4")]
        parts += [text(x, y + 68, f"bearing {name}")]
        parts += [
            line(x, y - 50, x, y - 88, BLUE),
            text(x + 8, y - 76, f"F_x{name}", BLUE, "start"),
        ]
        parts += [text(x, y - 96, f"x_{name}", BLUE)]
    parts += [line(250, y, 250, y - 96, BLUE), text(258, y - 84, "x", BLUE, "start")]
    parts += [line(20, y, 482, y, SOFT, dash="6 4"), text(476, y - 8, "z", INK)]
    # theta_y turns z towards x: from the right end upwards.
    parts += [arc(250, y, 78, 6, 50, RED), text(330, y - 42, "θ_y", RED, "start")]
    for x1, x2, name in ((100, 250, "L_a"), (250, 400, "L_b")):
        parts += [line(x1 + 2, y + 92, x2 - 2, y + 92, SOFT, width=1.2)]
        parts += [text((x1 + x2) / 2, y + 108, name)]
    return [*parts, text(250, y + 132, "at a: x_a = x - L_a θ_y,  y_a = y + L_a θ_x")]


def end() -> list[str]:
    """Return the rotor seen against z: x to the right, y up."""
    x, y, r = 680, 150, 62
    mark, unbalance = 25.0, 70.0
    parts = [text(x, 24, "seen against z (z towards you)")]
    parts += [f'<circle cx="{x}" cy="{y}" r="{r}" fill="#dadce0" stroke="{INK}"/>']
    parts += [line(x, y, x + 128, y, BLUE), text(x + 134, y + 5, "x", BLUE, "start")]
    parts += [line(x, y, x, y - 112, BLUE), text(x + 10, y - 104, "y", BLUE, "start")]
    for magnet, words in ((96, "+"), (-96, "-")):
        parts += [box(x + magnet, y, 26, 46, "#f1f3f4"), text(x + magnet, y + 5, words)]
    for angle, length, colour in ((mark, r, INK), (unbalance, r - 10, RED)):
        dx, dy = (length * f(math.radians(angle)) for f in (math.cos, math.sin))
        parts += [line(x, y, x + dx, y - dy, colour, arrow=False, width=2.2)]
        if colour == RED:
            parts += [f'<circle cx="{x + dx:.4g}" cy="{y - dy:.4g}" r="6" fill="{RED}"/>']
    parts += [arc(x, y, 30, 0, mark, INK), text(x + 40, y - 5, "φ", INK)]
    parts += [arc(x, y, 44, mark, unbalance, RED)]
    parts += [text(x + 62, y - 58, "angle of unbalance", RED, "start")]
    parts += [arc(x, y, 80, 110, 165, INK), text(x - 84, y - 62, "Ω > 0", INK, "end")]
    parts += [text(x + r + 2, y - 30, "mark", INK, "start")]
    parts += [text(x, y + 92, "i > 0 pulls towards +x:  F_x = k_i i + k_s x")]
    return [*parts, text(x, y + 110, "k_i > 0, k_s > 0")]


def drawing() -> str:
    """Return the whole drawing as SVG."""
    heads = "".join(
        f'<marker id="head-{c[1:]}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" '
        f'markerHeight="7" orient="auto"><path d="M 0 0 L 10 5 L 0 10 z" fill="{c}"/></marker>'
        for c in (INK, SOFT, BLUE, RED)
    )
    body = "\n".join(part for part in (*side(), *end()) if part)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 920 300" font-family="sans-serif" '
        'font-size="13" role="img"><title>Coordinates, angles and signs</title>'
        f"<defs>{heads}</defs>"
        f'<rect width="920" height="300" fill="white"/>\n{body}\n</svg>\n'
    )


def main() -> None:
    """Write the drawing."""
    path = Path(__file__).parent / "images" / "coordinates.svg"
    path.write_text(drawing(), encoding="utf-8")


if __name__ == "__main__":
    main()
