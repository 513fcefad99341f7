"""The mechanism and what its responses measure, as SVG with a description in words."""

import math

from reporting.render.svg import PlotArea, box, dots, line, svg, text
from reporting.spec import DrawnLine, DrawnWords, MechanismDrawing

_WIDTHS = {"thin": 0.8, "dashed": 0.8, "thick": 3.0, "arrow": 1.6}
_HEAD = 9.0  # length of an arrow's head
_LETTER, _LINE = 0.6, 1.2  # width of a letter and height of a line, relative to the font size
_DARKEST = 0.18  # relative luminance of a colour whose contrast with white is 4.5


def mechanism_figure(drawing: MechanismDrawing) -> str:
    """Return the drawing of a mechanism."""
    marks = [_area(corners, colour) for corners, colour in drawing.areas]
    for stroke in drawing.strokes:
        dash = "3 2" if stroke.style == "dashed" else ""
        marks.append(line(stroke.points, stroke.colour, _WIDTHS[stroke.style], dash))
        marks += [_head(stroke)] if stroke.style == "arrow" and len(stroke.points) > 1 else []
    marks += [dots([(x, y)], colour, 2.4) for x, y, colour in drawing.dots]
    marks += [mark for words in drawing.words for mark in _words(words, drawing.text)]
    listed = "; ".join(f"{each.name}: {each.title or 'no title'}, {each.value}" for each in drawing.legend)
    frame = PlotArea(drawing.width, drawing.height, (0.0, 1.0), (0.0, 1.0))
    return svg(frame, f"The mechanism at its start, with arrows for what is measured. {listed}.", marks)


def _area(corners: tuple[tuple[float, float], ...], colour: str) -> str:
    """Return a body as a light area with an outline."""
    at = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    return f'<polygon points="{at}" fill="{colour}" fill-opacity="0.1" stroke="{colour}" stroke-opacity="0.6"/>'


def _head(stroke: DrawnLine) -> str:
    """Return the head of an arrow; a short arrow has a small one."""
    (ax, ay), (bx, by) = stroke.points[-2:]
    length = math.hypot(bx - ax, by - ay)
    if length == 0:
        return ""
    x, y = (bx - ax) / length, (by - ay) / length
    size = min(_HEAD, max(length, 0.5 * _HEAD))
    sides = [(bx - size * x - s * 0.4 * size * y, by - size * y + s * 0.4 * size * x) for s in (-1, 1)]
    at = " ".join(f"{px:.1f},{py:.1f}" for px, py in ((bx, by), *sides))
    return f'<polygon points="{at}" fill="{stroke.colour}"/>'


def _words(words: DrawnWords, size: float) -> list[str]:
    """Return text on a white, slightly transparent background."""
    size = size if words.bold else 0.92 * size
    wide, tall = _LETTER * size * max(map(len, words.lines)), _LINE * size
    top = words.y - 0.5 * tall * len(words.lines)
    more = f'font-size="{size:.3g}"' + (' font-weight="700"' if words.bold else "")
    ground = box(words.x - 0.5 * wide, top, wide, tall * len(words.lines), "white", 'fill-opacity="0.75"')
    colour = readable(words.colour)
    rows = (text(words.x, top + tall * (i + 0.78), each, "middle", colour, more) for i, each in enumerate(words.lines))
    return [ground, *rows]


def readable(colour: str) -> str:
    """Return a colour, darkened if necessary, so that text in it is readable on white (WCAG 2.2 AA)."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    while _luminance(channels) > _DARKEST:
        channels = [0.95 * channel for channel in channels]
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in channels)


def _luminance(channels: list[float]) -> float:
    """Return the relative luminance of red, green and blue from 0 to 1 (sRGB)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
