"""Find all splat fields of a stage, and for each field the variants that change its data.

Fields that exist only in variants that are not selected are found too.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from pxr import Sdf, Tf, Usd, UsdVol

from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.schema.lod_roots import find_roots

MOST = 64
"""Largest number of combinations of variants for one field."""
_MOST_WALKED = 1024
"""Largest number of combinations in which one prim of any type is visited."""

Selection = tuple[tuple[Sdf.Path, str, str], ...]
"""(prim, variant set, variant) of each set on the way to a field, outermost first. The variant is
"" if none of the set's own is selected: the stage has no selection, or a wrong one."""
_Opinions = tuple[object, ...]
_COMPOSING = (
    *("references", "payload", "inheritPaths", "specializes", "variantSelection"),
    *("active", "instanceable", "clips", "clipSets"),
)
"""Metadata of prims that can change which fields there are, and their data."""


@dataclass(frozen=True, slots=True)
class FieldVariants:
    """A field with the combinations of variants between which its data differs."""

    path: Sdf.Path
    selections: tuple[Selection, ...]
    """Combinations in which the field exists; that of the stage is last."""
    relevant: frozenset[tuple[Sdf.Path, str]]
    """(prim, variant set) of the sets that change the data, or whether the field exists."""

    @property
    def is_unselected(self) -> bool:
        """Whether the data differs between the variants of a set and none of them."""
        return any(
            not part[2] and part[:2] in self.relevant
            for selection in self.selections
            for part in selection
        )

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
        stage: The stage. Its session layer, which selects no variants, is changed and restored.

    Raises:
        StageError: If a field has more than MOST combinations of variants, or so many sets are
            nested that walking through all combinations would take too long.
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
    """Select variants in the session layer of a stage; for the variant "", select none there."""
    session = stage.GetSessionLayer()
    for path, name, variant in selection:
        spec = session.GetPrimAtPath(path)
        if spec is not None and spec.variantSelections.get(name, "") == variant:
            continue  # the stage would be composed again
        if variant:
            with Usd.EditContext(stage, session):
                stage.GetPrimAtPath(path).GetVariantSet(name).SetVariantSelection(variant)
        elif spec is not None:
            del spec.variantSelections[name]


def opinions(prim: Usd.Prim) -> _Opinions:
    """Return the sites of the opinions that determine the data of a field, strongest first by
    attribute."""
    found: list[object] = [prim.GetTypeName(), str(prim.GetMetadata("clips"))]
    for name in sorted(schema.DATA_ATTRIBUTES):
        attribute = prim.GetAttribute(name)
        if attribute:
            for spec, offset in attribute.GetPropertyStackWithLayerOffsets():
                found.append((spec.layer.identifier, spec.path, offset.offset, offset.scale))
                if spec.HasDefaultValue():
                    break  # it hides the weaker ones at every time
    return tuple(found)


def _has_data(found: _Opinions) -> bool:
    """Return whether opinions are more than a type."""
    return len(found) > 2 or found[1] != str(None)


class _Walk:
    """A traversal of a stage with every combination of the variants above each field."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage = stage
        self._roots = find_roots(stage)
        self._found: dict[Sdf.Path, list[tuple[Selection, _Opinions]]] = {}
        self._visits: dict[Sdf.Path, int] = {}
        self._concerned: dict[tuple[str, Sdf.Path], bool] = {}

    def visit(self, path: Sdf.Path, fixed: Selection) -> None:
        """Visit a prim and everything below it, with the variants above it as selected."""
        prim = self._stage.GetPrimAtPath(path)
        if not prim or prim.IsInstanceProxy():
            return
        known = {name for place, name, _ in fixed if place == path}
        for name in () if prim.IsPseudoRoot() else prim.GetVariantSets().GetNames():
            if name in known or not self._concerns_fields(prim, name):
                continue
            chosen = prim.GetVariantSet(name).GetVariantSelection()
            variants = prim.GetVariantSet(name).GetVariantNames()
            variants = sorted(variants, key=lambda each: each == chosen)
            for variant in variants if chosen in variants else [*variants, ""]:
                choice = (path, name, variant)
                select(self._stage, (choice,))
                self.visit(path, (*fixed, choice))
            select(self._stage, ((path, name, ""),))
            return
        self._visits[path] = self._visits.get(path, 0) + 1
        _check_count(path, self._visits[path], _MOST_WALKED)
        if schema.is_splat_field(prim) and not self._roots.is_replaced(prim):
            seen = self._found.setdefault(path, [])
            seen.append((fixed, opinions(prim)))
            _check_count(path, len(seen), MOST)
        if prim.IsInstance():
            return
        for child in prim.GetFilteredChildrenNames(Usd.PrimAllPrimsPredicate):
            self.visit(path.AppendChild(child), fixed)

    def _concerns_fields(self, prim: Usd.Prim, name: str) -> bool:
        """Return whether the variants of a set may have opinions on fields or their data."""
        found = False
        for spec in prim.GetPrimStack():
            if name not in spec.variantSets:
                continue
            key = (spec.layer.identifier, spec.path.AppendVariantSelection(name, ""))
            if key not in self._concerned:
                variants = spec.variantSets[name].variants
                self._concerned[key] = any(map(self._composes_fields, variants))
            found |= self._concerned[key]
        return found

    def _composes_fields(self, variant: Sdf.VariantSpec) -> bool:
        """Return whether a variant may add, remove or change fields."""
        layer, found = variant.layer, []

        def visit(path: Sdf.Path) -> None:
            if path.IsPropertyPath():
                found.append(path.name in schema.DATA_ATTRIBUTES)
            elif path.IsPrimPath() or path.IsPrimVariantSelectionPath():
                spec = layer.GetPrimAtPath(path)
                found.append(any(map(spec.HasInfo, _COMPOSING)) or self._retypes(spec))

        layer.Traverse(variant.primSpec.path, visit)
        return any(found)

    def _retypes(self, spec: Sdf.PrimSpec) -> bool:
        """Return whether a spec gives a prim a type with which it is, or was, a field."""
        if not spec.typeName:
            return False
        known = Usd.SchemaRegistry.GetConcreteTypeFromSchemaTypeName(spec.typeName)
        if known == Tf.Type.Unknown or known.IsA(UsdVol.ParticleField3DGaussianSplat):
            return True
        if spec.typeName in (schema.tokens.PACKED_TYPE, schema.tokens.PRERELEASE_TYPE):
            return True
        path = spec.path.StripAllVariantSelections()
        return schema.is_splat_field(self._stage.GetPrimAtPath(path))

    def result(self) -> list[FieldVariants]:
        """Return the fields, by path."""
        found = []
        for path, seen in sorted(self._found.items()):
            relevant = frozenset(each for each in _sets(seen) if self._matters(each, seen))
            once = {
                tuple(part for part in selection if part[:2] in relevant): selection
                for selection, _ in seen
            }
            data_of = dict(seen)
            needed = tuple(
                each
                for each in once.values()
                if _has_data(data_of[each]) or all(part[2] for part in each if part[:2] in relevant)
            )
            if needed:
                found.append(FieldVariants(path, needed, relevant))
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
        return any(
            len(each.keys() - {""}) != count or len(set(each.values())) > 1
            for each in by_others.values()
        )


def _check_count(path: Sdf.Path, count: int, most: int) -> None:
    """Raise an error if a prim has more combinations of variants than the largest number."""
    if count > most:
        found = f"more than {most} combinations of variants"
        raise StageError(str(path), found, "fewer, or --flatten")


def _sets(seen: list[tuple[Selection, _Opinions]]) -> set[tuple[Sdf.Path, str]]:
    return {(prim, name) for selection, _ in seen for prim, name, _ in selection}
