"""The SVG of a figure in a third of the bytes: the same picture to a twentieth of a point."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree

SVG = "{http://www.w3.org/2000/svg}"
FAMILY = "DejaVu Sans"
LONG = 20
"""Corners of a path that is more than a mark or a frame."""
_REFERENCE = re.compile(r"(?<=#)\w+")


def lean(svg: str) -> str:
    """Return the picture with short numbers and names, each style once, no metadata, no groups without effect."""
    ElementTree.register_namespace("", SVG.strip("{}"))
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    root = ElementTree.fromstring(svg)
    _drop(root)
    for group in root.iter(f"{SVG}g"):  # marks of one line have one style
        marks = {(mark.tag, mark.get("style")) for mark in group}
        if len(marks) == 1 and (mark := marks.pop())[0] == f"{SVG}use" and mark[1] and not group.get("style"):
            group.set("style", mark[1])
            for child in group:
                child.attrib.pop("style")
    used = set(_REFERENCE.findall(svg))
    names = {name: f"i{number}" for number, name in enumerate(sorted(used & {each.get("id") for each in root.iter()}))}
    styles: dict[str, str] = {}
    for element in root.iter():
        element.attrib.update({key: _REFERENCE.sub(lambda name: names.get(name[0], name[0]), text)
                               for key, text in element.items()})
        if style := re.sub(f"font-family: '{FAMILY}'[^;]*(; |$)", "", element.attrib.pop("style", "")):
            element.set("class", styles.setdefault(style, f"c{len(styles)}"))
        if name := names.get(element.attrib.pop("id", "")):
            element.set("id", name)
        for key, text in list(element.items()):
            if key not in ("class", "id"):
                element.set(key, (_path if key == "d" else _rounded)(text))
    rules = [f"text{{font-family: {FAMILY}, sans-serif}}", *(f".{name}{{{style}}}" for style, name in styles.items())]
    if (style_sheet := root.find(f"{SVG}defs/{SVG}style")) is not None:
        style_sheet.text = f"{style_sheet.text or ''}{''.join(rules)}"
    return re.sub(r'="([^"\']*)"', r"='\1'", ElementTree.tostring(root, encoding="unicode"))


def _drop(root: ElementTree.Element) -> None:
    """Remove metadata, turns by nothing, blanks between elements, and groups that have no effect."""
    for parent in list(root.iter()):
        children: list[ElementTree.Element] = []
        for child in parent:
            if re.match("rotate\\(-?0 ", child.get("transform", "")):
                child.attrib.pop("transform")
            if child.tag != f"{SVG}metadata":
                children += _without_groups(child)
        parent[:] = children
        if not parent.tag.startswith((f"{SVG}t", f"{SVG}style")):  # text, tspan
            parent.text = None
            for child in children:
                child.tail = None


def _without_groups(element: ElementTree.Element) -> Iterator[ElementTree.Element]:
    if element.tag == f"{SVG}g" and not element.attrib.keys() - {"id"}:
        for child in element:
            yield from _without_groups(child)
    else:
        yield element


def _path(text: str) -> str:
    """A long path of straight lines relative to its points, to a tenth of a point; any other to a hundredth."""
    if text.count("L") < LONG or re.search("[CQ]", text):
        return _rounded(" ".join(text.split()))
    parts, at, start = [], (0, 0), (0, 0)
    for command, *place in re.findall(r"([MLz])(?: (\S+) (\S+))?", text):
        if command == "z":
            parts.append("z")
            at = start
            continue
        x, y = (round(10 * float(number)) for number in place)
        if (x, y) != at or command == "M":
            parts.append(f"{command.lower()}{_tenths(x - at[0])} {_tenths(y - at[1])}".replace(" -", "-"))
        at = x, y
        start = at if command == "M" else start
    return "".join(parts)


def _tenths(number: int) -> str:
    return re.sub(r"^(-?)0\.", r"\1.", f"{number / 10:g}")


def _rounded(text: str) -> str:
    return re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), text)
