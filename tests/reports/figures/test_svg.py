"""A lean SVG is the same picture: texts, places and colours, in fewer bytes, and fit for an attribute of a page."""

import re
from html import escape
from urllib.parse import quote, unquote
from xml.etree import ElementTree

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stiction.reports.figures.svg import LONG, lean
from stiction.reports.page.run_page import UNQUOTED

SVG = "{http://www.w3.org/2000/svg}"
FONT = "font-family: 'DejaVu Sans', sans-serif"


def picture(content: str) -> str:
    """As matplotlib writes it."""
    return ('<?xml version="1.0"?>\n<svg xmlns:xlink="http://www.w3.org/1999/xlink" xmlns="http://www.w3.org/2000/svg">'
            '<metadata>m</metadata>\n'
            f'<defs><style type="text/css">*{{}}</style></defs><g id="a_1"><g id="text_1">{content}</g></g></svg>')


@given(st.text("<>#%&'\"é ", max_size=20), st.floats(-999, 999))
def test_texts_stay_and_places_to_a_hundredth(words, x):
    text = f'<text style="font-size: 7px; {FONT}" x="{x:.6f}" transform="rotate(-0 1 2)">{escape(words)}</text>'
    made = lean(picture(text))
    [found] = ElementTree.fromstring(unquote(quote(made, safe=UNQUOTED))).iter(f"{SVG}text")
    assert abs(float(found.get("x")) - x) <= 0.01 and (found.text or "").split() == words.split()
    assert "transform" not in found.attrib and "<g" not in made and "metadata" not in made
    assert '"' not in quote(made, safe=UNQUOTED) and "#" not in quote(made, safe=UNQUOTED)


@given(st.lists(st.tuples(st.floats(0, 500), st.floats(0, 500)), min_size=LONG + 1, max_size=60), st.booleans())
def test_every_corner_of_a_line_stays_to_a_twentieth_of_a_point(places, closed):
    """Two lines; each begins anew, wherever the one before it has ended."""
    corners = [zip("M" + "L" * len(places), line) for line in (places, places[::-1])]
    end = "z \n" * closed
    lines = end.join("".join(f"{command} {x:.6f} {y:.6f} \n" for command, (x, y) in line) for line in corners) + end
    [path] = ElementTree.fromstring(lean(picture(f'<path d="{lines}" style="fill: none"/>'))).iter(f"{SVG}path")
    at, start, found = np.zeros(2), np.zeros(2), []
    for command, x, y in re.findall(r"([mlz])(?:(-?[\d.]+) ?(-?[\d.]+))?", path.get("d")):
        at = start if command == "z" else at + [float(x), float(y)]
        start = at if command == "m" else start
        found += [at] if command != "z" else []
    expected = np.round([*places, *places[::-1]], 1)
    distances = np.abs(np.array(found)[:, None] - expected).max(axis=2)
    assert distances.min(axis=0).max() < 0.11 and distances.min(axis=1).max() < 0.11


def test_styles_stand_once_and_what_is_referred_to_keeps_a_name():
    style = "fill: url(#h0a1b2c3); stroke: #332288"
    paths = "".join(f'<path id="p{x}" d="M {x} {x}" style="{style}"/>' for x in (0, 1))
    made = lean(picture(f'<defs><pattern id="h0a1b2c3"/></defs>{paths}'))
    root = ElementTree.fromstring(made)
    [name] = {path.get("class") for path in root.iter(f"{SVG}path")}
    [pattern] = root.iter(f"{SVG}pattern")
    assert f".{name}{{fill: url(#{pattern.get('id')}); stroke: #332288}}" in root.find(f"{SVG}defs/{SVG}style").text
    assert made.count("id=") == 1
