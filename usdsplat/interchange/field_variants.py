"""Find the splat fields of a stage in all its variants, and the variants that their data needs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.errors import StageError

MOST = 64
"""Largest number of combinations of variants for one field."""

Selection = tuple[tuple[Sdf.Path, str, str], ...]
"""(prim, variant set, variant) of each set on the way to a field, outermost first."""
_Opinions = tuple[object, ...]


@dataclass(frozen=True, slots=True)
class FieldVariants:
    """A field with the combinations of variants between which its data differs."""

    path: Sdf.Path
    selections: tuple[Selection, ...]
    """Combinations in which the field exists; that of the stage is last."""
    relevant: frozenset[tuple[Sdf.Path, str]]
    """(prim, variant set) of the sets that change the data, or whether the field exists."""

    def spec_path(self, selection: Selection) -> Sdf.Path:
        """Return the deepest variant of a combination that the data depends on, as a path of specs;
        "/" if it depends on none."""
        found = Sdf.Path.absoluteRootPath
        for prim, name, variant in selection:
            if (prim, name) in self.relevant:
                last = found.StripAllVariantSelections()
                found = found.AppendPath(prim.MakeRelativePath(last)) if prim != last else found
                found = found.AppendVariantSelection(name, variant)
        return found


def field_variants(stage: Usd.Stage) -> list[FieldVariants]:
    """Return the fields of a stage in all its variants, without those in instances.

    Args:
        stage: The stage. Its session layer is changed, and restored.

    Raises:
        StageError: If a field has more than MOST combinations of variants.
    """
    walk = _Walk(stage)
    with kept_selections(stage):
        walk.visit(stage.GetPseudoRoot().GetPath(), ())
    return walk.result()


@contextmanager
def kept_selections(stage: Usd.Stage) -> Iterator[None]:
    """Restore the session layer of a stage afterwards."""
    session = stage.GetSessionLayer()
    before = Sdf.Layer.CreateAnonymous(".usda")
    before.TransferContent(session)
    try:
        yield
    finally:
        session.TransferContent(before)


def select(stage: Usd.Stage, selection: Selection) -> None:
    """Select variants in the session layer of a stage."""
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path, name, variant in selection:
            stage.GetPrimAtPath(path).GetVariantSet(name).SetVariantSelection(variant)


def opinions(prim: Usd.Prim) -> _Opinions:
    """Return the sites of all opinions on the data of a field, strongest first by attribute."""
    found: list[object] = [prim.GetTypeName(), str(prim.GetMetadata("clips"))]
    for name in sorted(schema.DATA_ATTRIBUTES):
        attribute = prim.GetAttribute(name)
        if attribute:
            for spec, offset in attribute.GetPropertyStackWithLayerOffsets():
                found.append((spec.layer.identifier, spec.path, offset.offset, offset.scale))
    return tuple(found)


class _Walk:
    """A traversal of a stage with every combination of the variants above each field."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage = stage
        self._found: dict[Sdf.Path, list[tuple[Selection, _Opinions]]] = {}

    def visit(self, path: Sdf.Path, fixed: Selection) -> None:
        """Visit a prim and everything below it, with the variants above it as selected."""
        prim = self._stage.GetPrimAtPath(path)
        if not prim or prim.IsInstanceProxy():
            return
        known = {name for place, name, _ in fixed if place == path}
        for name in () if prim.IsPseudoRoot() else prim.GetVariantSets().GetNames():
            variants = prim.GetVariantSet(name).GetVariantNames()
            if name in known or not variants:
                continue
            chosen = prim.GetVariantSet(name).GetVariantSelection()
            for variant in sorted(variants, key=lambda each: each == chosen):
                choice = (path, name, variant)
                select(self._stage, (choice,))
                self.visit(path, (*fixed, choice))
            return
        if schema.is_splat_field(prim):
            seen = self._found.setdefault(path, [])
            seen.append((fixed, opinions(prim)))
            if len(seen) > MOST:
                found = f"more than {MOST} combinations of variants"
                raise StageError(str(path), found, "fewer, or --flatten")
        if prim.IsInstance():
            return
        for child in prim.GetFilteredChildrenNames(Usd.PrimAllPrimsPredicate):
            self.visit(path.AppendChild(child), fixed)

    def result(self) -> list[FieldVariants]:
        """Return the fields, by path."""
        found = []
        for path, seen in sorted(self._found.items()):
            relevant = frozenset(each for each in _sets(seen) if self._matters(each, seen))
            once = {
                tuple(part for part in selection if part[:2] in relevant): selection
                for selection, _ in seen
            }
            found.append(FieldVariants(path, tuple(once.values()), relevant))
        return found

    def _matters(
        self, which: tuple[Sdf.Path, str], seen: list[tuple[Selection, _Opinions]]
    ) -> bool:
        """Return whether a field or its data differ between the variants of a set."""
        by_others: dict[Selection, dict[str, _Opinions]] = {}
        for selection, data in seen:
            variants = [variant for prim, name, variant in selection if (prim, name) == which]
            others = tuple(part for part in selection if part[:2] != which)
            if not variants:
                return True  # the set itself is inside a variant
            by_others.setdefault(others, {})[variants[0]] = data
        prim = self._stage.GetPrimAtPath(which[0])
        count = len(prim.GetVariantSet(which[1]).GetVariantNames()) if prim else 0
        return any(len(each) != count or len(set(each.values())) > 1 for each in by_others.values())


def _sets(seen: list[tuple[Selection, _Opinions]]) -> set[tuple[Sdf.Path, str]]:
    return {(prim, name) for selection, _ in seen for prim, name, _ in selection}
