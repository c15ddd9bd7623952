"""The cut of a picture by its definition: all nodes are measured, then the budget decides."""

from __future__ import annotations

import numpy as np

from usdsplat.render.lod.measure import NodeMeasure


def exhaustive(views, trees, error, budget):
    """The limit, the number of splats, and the nodes of each tree that the cut reaches.

    Args:
        views: The trees.
        trees: Their `all_reached`.
        error: Limit without a budget.
        budget: See `choose`.

    Returns:
        limit, splats, and for each tree the rows (node, instance, error, above, seen, shown).
    """
    base = sum(size for rows in trees for *_, size, parent in rows if parent < 0)
    steps = {}
    for view, rows in zip(views, trees, strict=True):
        for node, _, worst, *_, size, parent in rows:
            if parent >= 0:
                above = rows[parent][2]
                steps[above] = steps.get(above, 0) + size
            if worst > error:
                steps[worst] = steps.get(worst, 0) - int(view.table.proxies[node])
    limit, splats, total = None, base, base
    for worst in sorted(steps, reverse=True):  # nodes with equal errors are refined together
        limit = worst if limit is None else limit
        total += steps[worst]
        if budget == 0 or total <= budget or np.isinf(worst):
            limit, splats = None, total
    limit = error if limit is None else limit
    return limit, splats, [sorted(r[:6] for r in rows if r[3] > limit) for rows in trees]


def all_reached(view, screens, error):
    """Rows (node, instance, error, above, seen, shown, size, parent's row) without a budget."""
    table = view.table
    measures = [
        NodeMeasure(table, screen, placing, view.tangential)
        for screen, placing in zip(screens, view.placings, strict=True)
    ]
    waiting = [(0, i, np.inf, -1) for i in range(len(view.placings[0].transforms))]
    rows = []
    for node, instance, above, parent in waiting:
        found = [each.of(np.array([instance]), np.array([node])) for each in measures]
        worst = min(above, max(float(each.errors[0]) for each in found))
        count = int(table.child_count[node])
        worst = worst if count and node not in view.closed else 0.0
        shown = any(bool(each.shown[0]) for each in found)
        seen = any(bool(each.in_window[0]) for each in found)
        size = int(table.proxies[node] + table.residents[node]) if shown else 0
        rows.append((node, instance, worst, above, seen, shown, size, parent))
        if worst > error:
            first = int(table.first_child[node])
            waiting += [(first + i, instance, worst, len(rows) - 1) for i in range(count)]
    return rows
