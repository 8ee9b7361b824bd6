"""The import graph of the three packages, as the tests ask it."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter

import grimp

PACKAGES = ("hilbridge", "firmware_sim", "hilscenario")


def build() -> grimp.ImportGraph:
    """Every import of the sources, those for type checking too."""
    return grimp.build_graph(*PACKAGES, cache_dir=None)


def between_children(graph: grimp.ImportGraph, package: str) -> dict[str, set[str]]:
    """Which child of a package (with all that is in it) imports which other one."""
    children = graph.find_children(package)
    owner = {module: child for child in children for module in {child, *graph.find_descendants(child)}}
    edges: dict[str, set[str]] = {child: set() for child in children}
    for module, child in owner.items():
        for imported in graph.find_modules_directly_imported_by(module):
            target = owner.get(imported)
            if target is not None and target != child:
                edges[child].add(target)
    return edges


def cycle(edges: dict[str, set[str]]) -> list[str]:
    """One cycle among the nodes, or nothing."""
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []
