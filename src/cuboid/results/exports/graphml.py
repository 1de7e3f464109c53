"""GraphML: objects, furniture and surfaces as nodes, relations as edges; networkx, igraph, Gephi and yEd read it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from cuboid.ground.core.results import SupportPlane, TrackedObject, Wall
from cuboid.results.exports.plain_json import kind_of
from cuboid.results.files import Results
from cuboid.results.files.text import LENGTH, rounded

NAMESPACE = "http://graphml.graphdrawing.org/xmlns"
# Attributes of nodes and edges, with their types in GraphML.
NODE = {
    "kind": "string",
    "label": "int",
    "name": "string",
    **dict.fromkeys(("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "score", "probability"), "double"),
}
EDGE = {"relation": "string", "score": "double"}
NO_UP = "up is unknown, and so are relations: the graph has no edges"

Value = str | int | float


def write(run: Results, path: Path) -> list[str]:
    """Write the file."""
    root = ElementTree.Element("graphml", xmlns=NAMESPACE)
    for target, attributes in (("node", NODE), ("edge", EDGE)):
        for name, kind in attributes.items():
            key = {"id": f"{target}_{name}", "for": target, "attr.name": name, "attr.type": kind}
            ElementTree.SubElement(root, "key", key)
    graph = ElementTree.SubElement(root, "graph", id="place", edgedefault="directed")
    relations = run.relations
    for item in (*run.objects, *run.furniture):
        _with_data(graph, "node", {"id": f"object:{item.label}"}, _object(item))
    for number, plane in enumerate(run.planes):
        _with_data(graph, "node", {"id": f"plane:{number}"}, _surface("plane", plane))
    for number, wall in enumerate(run.walls):
        _with_data(graph, "node", {"id": f"wall:{number}"}, _surface("wall", wall))
    every = relations | {item.label: item.relations for item in run.furniture}
    for label, found in sorted(every.items()):
        for one in found:
            ends = {"source": f"object:{label}", "target": f"object:{one.to}" if isinstance(one.to, int) else one.to}
            _with_data(graph, "edge", ends, {"relation": one.kind, "score": rounded(one.score, LENGTH)})
    for item in run.furniture:
        for number in item.planes:
            ends = {"source": f"object:{item.label}", "target": f"plane:{number}"}
            _with_data(graph, "edge", ends, {"relation": "bears", "score": 1.0})
    ElementTree.indent(root)
    path.write_bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")
    return [] if run.up is not None else [NO_UP]


def _with_data(graph: ElementTree.Element, kind: str, names: Mapping[str, str], values: Mapping[str, Value]) -> None:
    element = ElementTree.SubElement(graph, kind, dict(names))
    for name, value in values.items():
        ElementTree.SubElement(element, "data", key=f"{kind}_{name}").text = str(value)


def _object(item: TrackedObject) -> dict[str, Value]:
    numbers = (*item.box.center.tolist(), *item.box.size.tolist(), item.score, item.probability)
    return {
        "kind": kind_of(item),
        "label": item.label,
        **({"name": "".join(one for one in item.name if one.isprintable())} if item.name else {}),
        **{name: rounded(value, LENGTH) for name, value in zip(list(NODE)[3:], numbers, strict=True)},
    }


def _surface(what: str, surface: SupportPlane | Wall) -> dict[str, Value]:
    center = surface.extent.mean(0).tolist()
    return {"kind": what, **{name: rounded(value, LENGTH) for name, value in zip(list(NODE)[3:6], center, strict=True)}}
