"""Write converted and edited splat fields on another stage, and keep account of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edits import Edit
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.progress import Progress
from usdsplat.interchange.authoring import missing_proxy
from usdsplat.interchange.editing import edited
from usdsplat.interchange.exporting import unknown_color_spaces
from usdsplat.interchange.models import update_extents
from usdsplat.interchange.provenance import add_edits, add_form
from usdsplat.schema import Form


class FieldWriter:
    """The form and the edits that fields of a stage get, and what was written so far.

    Args:
        form: Form of all fields.
        edits: Edits of every field and sample, in order.
        progress: Receives the progress by clouds.
    """

    def __init__(self, form: Form, edits: Sequence[Edit], progress: Progress) -> None:
        self.form = form
        self.edits = tuple(edits)
        self.samples = 0
        """Number of clouds written."""
        self.splats = 0
        """Number of splats in them."""
        self.variants = 0
        """Number of combinations of variants written, those of all fields together."""
        self.paths: dict[str, None] = {}
        """Paths of the fields written, each once."""
        self.notes: dict[str, None] = {}
        """Notes, each once."""
        self._progress = progress
        self._clouds = 0

    def changes(self, field: Usd.Prim) -> bool:
        """Return whether a field has another form, or is edited."""
        return bool(self.edits) or schema.form_of(field) != self.form

    def times(self, field: Usd.Prim) -> Sequence[float | None]:
        """Return the sample times of a field, or [None] for its default value."""
        return schema.sample_times(field) or [None]

    def expect(self, clouds: int) -> None:
        """Set the number of clouds that progress is reported of."""
        self._clouds = clouds

    def write(self, field: Usd.Prim, stage: Usd.Stage, times: Sequence[float | None]) -> None:
        """Write the clouds of a field at these times on the edit target of another stage."""
        for time in times:
            self._progress.step("repacking", self.samples, max(self._clouds, self.samples + 1))
            cloud, said = self._edited(field, time)
            self._note(said)
            schema.author(stage, field.GetPath(), cloud, form=self.form, time=time)
            self.samples += 1
            self.splats += len(cloud)

    def finish(self, field: Usd.Prim, written: Usd.Prim) -> None:
        """Bring provenance and bounds up to date with a field that was written."""
        path = str(field.GetPath())
        self.variants += 1
        self.paths[path] = None
        if self.edits:
            add_edits(written, self.edits)
        if schema.form_of(field) != self.form:
            add_form(written, self.form)
        self._note(f"{path}: {rule}" for rule in schema.broken_rules(written))
        self._note(missing_proxy(written))
        update_extents(written)

    def note_color_spaces(self, fields: Sequence[Usd.Prim]) -> None:
        """Note fields with unknown colour spaces, first of all."""
        self.notes = dict.fromkeys([*unknown_color_spaces(fields), *self.notes])

    def _note(self, notes: Iterable[str]) -> None:
        self.notes.update(dict.fromkeys(notes))

    def _edited(self, field: Usd.Prim, time: float | None) -> tuple[SplatCloud, list[str]]:
        """Return a field's edited cloud at one of its times, and notes."""
        cloud = schema.fetch(field, time)
        if not self.edits:
            return cloud, []
        where, moves = str(field.GetPath()), schema.is_time_varying(field)
        for item in self.edits:
            if moves and not item.kind.row_by_row:
                raise UsageError(f"edit {item.name}", f"{where}, which moves", "a static field")
        if moves and cloud.ids is None and not all(item.kind.keeps_rows for item in self.edits):
            # Without ids, a splat would be interpolated to another one in its row at the next
            # sample.
            cloud = replace(cloud, ids=np.arange(len(cloud)))
        antialiased = schema.rasterize_mode(field) == "antialiased"
        after, notes = edited(cloud, self.edits, may_empty=moves, antialiased=antialiased)
        place = where if time is None else f"{where} at {time:g}"
        return after, [f"{place}: {note}" for note in notes]


def no_field(stage: Usd.Stage, where: str) -> StageError:
    """Return the error of a stage without splat fields, which says whether it has splat trees."""
    if any(schema.is_tree(prim) for prim in stage.TraverseAll()):
        expected = "a splat field; a tree becomes a capture, such as OUT.ply"
        return StageError(where, "splat trees and no splat field", expected)
    return StageError(where, "no splat field", "at least one")


def remove_data(
    layer: Sdf.Layer, specs: Iterable[Sdf.Path], names: Set[str] = schema.DATA_ATTRIBUTES
) -> None:
    """Remove the data of a field from its specs, which are then written again; else it could hide
    the new data, or mix with it.

    Args:
        layer: The layer.
        specs: Paths of the field's specs, in variants too.
        names: Attributes to remove.
    """
    for spec in filter(None, map(layer.GetPrimAtPath, specs)):
        for name in names & set(spec.properties.keys()):
            del spec.properties[name]


@contextmanager
def restored_specifiers(layer: Sdf.Layer, path: Sdf.Path) -> Iterator[None]:
    """Restore the specifiers of a spec and its ancestors after authoring; new ones become `over`.

    Prototypes, which are under an `over`, would otherwise be drawn.
    """
    paths = [prefix for prefix in path.GetPrefixes() if not prefix.IsPrimVariantSelectionPath()]
    before = {each: _specifier(layer, each) for each in paths}
    yield
    for each, specifier in before.items():
        spec = layer.GetPrimAtPath(each)
        if spec and spec.specifier != specifier:
            spec.specifier = specifier


def _specifier(layer: Sdf.Layer, path: Sdf.Path) -> Sdf.Specifier:
    spec = layer.GetPrimAtPath(path)
    return spec.specifier if spec else Sdf.SpecifierOver
