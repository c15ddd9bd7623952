"""Author a user's edits of a stage as opinions on its session layer, with undo and redo.

    edits = Edits(stage)
    edits.set_value("/World/Ball.radius", 2.0)
    edits.undo()                                     # "Set radius"

No file is changed. A step that fails leaves no opinions behind. Consecutive steps with the same
`merge` key become one, so that one undo takes back a whole drag.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pxr import Sdf, Tf, Usd, UsdGeom

from usdsplat.core.errors import StageError, UsageError
from usdsplat.preview.knob_model import typed
from usdsplat.preview.stage_model.attribute_values import parameter_of, taken
from usdsplat.preview.stage_model.history import History, Snapshot, Step
from usdsplat.preview.stage_model.placing import EDIT, author_edit, code_of, edit_of
from usdsplat.render.specs import Matrix
from usdsplat.schema.layer_times import scale_times
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage.authoring import declare, usd_value

_MOST_SAMPLES = 10_000
"""Most time samples of weaker layers that are copied when a sample is set beside them."""


class Edits:
    """The edits of one stage, which can be undone and redone."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.stage = stage
        self.layer = stage.GetSessionLayer()
        self._kept, self._has_unsaved = _said(self.layer), False
        before = self.layer.timeCodesPerSecond
        self.follow_rate()
        scale_times(self.layer, self.layer.timeCodesPerSecond / before)
        self._kept = _said(self.layer)
        self._history = History(self.layer)
        self._saved = self._compared = self._history.state
        """States of the history when the edits were saved, and when they were last compared."""

    def follow_rate(self) -> None:
        """Give the layer the rate of the stage's own layers, so that a key at a time of the stage
        is at this time: USD scales the times of a layer with another rate, or without one."""
        rate = self.stage.GetRootLayer().timeCodesPerSecond
        if rate == self.layer.timeCodesPerSecond == self.stage.GetTimeCodesPerSecond():
            return
        is_said = not self._has_unsaved and self._kept == _said(self.layer)
        self.layer.timeCodesPerSecond = rate
        if is_said:  # the rate is none of the user's edits
            self._kept = _said(self.layer)

    @property
    def has_unsaved(self) -> bool:
        """Whether the layer says something else than at the last `note_saved`, or at the start.

        Edits that take back each other are none, such as hiding a prim and showing it again.
        """
        if not _is_same(self._history.state, self._compared):
            self._compared = self._history.state
            self._has_unsaved = not _is_same(self._compared, self._saved)
            if self._has_unsaved:
                self._has_unsaved = _said(self.layer) != self._kept
        return self._has_unsaved

    def note_saved(self) -> None:
        """Note that the session layer was saved."""
        self._saved = self._compared = self._history.state
        self._kept, self._has_unsaved = _said(self.layer), False

    @property
    def undoable(self) -> str | None:
        """Name of the step that `undo` would take back; None for none."""
        return self._history.undoable

    @property
    def redoable(self) -> str | None:
        """Name of the step that `redo` would repeat; None for none."""
        return self._history.redoable

    def undo(self) -> str | None:
        """Undo the last step and return its name; None if there is none."""
        return self._history.undo()

    def redo(self) -> str | None:
        """Redo the last undone step and return its name; None if there is none."""
        return self._history.redo()

    def take_back(self, merge: str) -> None:
        """Undo the steps with this key, if they are the last, and forget them."""
        self._history.take_back(merge)

    def close(self) -> None:
        """Forget all steps; the edits stay."""
        self._history.clear()

    @contextmanager
    def step(self, name: str, *paths: str, merge: str | None = None) -> Iterator[None]:
        """Make everything authored inside, on the session layer, one step.

        Args:
            name: Name of the step, such as "Set radius".
            paths: Paths of all prims and properties that may be authored, including new ones.
            merge: Consecutive steps with the same key become one.

        Raises:
            StageError: If one of them cannot be edited, because it is in an instance or is not a
                path; or if USD rejects what is authored.
        """
        before = Snapshot(self.layer, [self._editable(path) for path in paths])
        try:
            with Usd.EditContext(self.stage, self.layer):
                yield
        except Tf.ErrorException as error:
            before.restore(self.layer)
            said = " ".join(error.args[0].commentary.split()) if error.args else "an error"
            raise StageError(name, said, "an opinion that USD can author") from None
        except BaseException:
            before.restore(self.layer)
            raise
        self._history.add(Step(name=name, merge=merge, before=before))

    def set_value(
        self, path: str, value: Any, *, time: float | None = None, merge: str | None = None
    ) -> None:
        """Set an attribute's value.

        Args:
            path: Path of the attribute, such as "/World/Ball.radius".
            value: Value of the attribute's editor: bool, number, str, or a sequence of numbers.
            time: Time code of a sample, added to the existing samples; None sets one value for all
                times, in place of any samples.
            merge: As for `step`.

        Raises:
            StageError: If there is no such attribute, or it cannot be edited.
            UsageError: If the value is invalid.
        """
        attribute = self._attribute(path)
        item = parameter_of(attribute)
        if item is None:
            checked = taken(path, attribute, value)
        else:
            checked = usd_value(attribute.GetName().partition(":")[2], typed(item, value))
        if time is not None and attribute.GetVariability() == Sdf.VariabilityUniform:
            raise UsageError(path, f"a value at {time:g}", "one value for all times")
        with self.step(f"Set {attribute.GetName()}", path, merge=merge):
            self._author(attribute, checked, time)

    def set_parameter(
        self,
        prim: Usd.Prim,
        name: str,
        value: Any,
        *,
        time: float | None = None,
        merge: str | None = None,
    ) -> None:
        """Set a simulation's parameter, and apply the schema that it belongs to.

        Args:
            prim: A SplatSim prim or an affector of the stage.
            name: Name of the parameter, such as "rd:patternScale".
            value: Value of its knob.
            time, merge: As for `set_value`.

        Raises:
            StageError: If it cannot be edited.
            UsageError: If the value is invalid.
        """
        checked = usd_value(name, value)
        path = f"{prim.GetPath()}.{NAMESPACE}:{name}"
        with self.step(f"Set {name}", str(prim.GetPath()), path, merge=merge):
            self._author(declare(prim, name), checked, time)

    def clear(self, path: str) -> None:
        """Remove the session layer's opinions on a property; other layers stay.

        Raises:
            StageError: If the session layer has none.
        """
        spec = self.layer.GetPropertyAtPath(path) if Sdf.Path.IsValidPathString(path) else None
        if spec is None:
            raise StageError(path, "no edit", "a property with an opinion on the session layer")
        with self.step(f"Clear {spec.name}", path):
            self.layer.GetPrimAtPath(spec.path.GetPrimPath()).RemoveProperty(spec)

    def set_visible(self, path: str, is_visible: bool, *, time: float | None = None) -> None:
        """Show or hide a prim at all times.

        A prim that is shown becomes visible even if ancestors were hidden. Their other children
        stay hidden, as in usdview.

        Args:
            path: Path of the prim.
            is_visible: Whether the prim should be visible.
            time: Time at which the hiding opinions are looked up.

        Raises:
            StageError: If there is no such prim, or it cannot be hidden.
        """
        prim = self._prim(path)
        if not prim.IsA(UsdGeom.Imageable):
            raise StageError(
                path, f"a {prim.GetTypeName() or 'prim without a type'}", "an imageable prim"
            )
        tokens = {path: UsdGeom.Tokens.inherited if is_visible else UsdGeom.Tokens.invisible}
        if is_visible:
            tokens = _way_out(prim, code_of(time))
        paths = [f"{each}.visibility" for each in tokens]
        with self.step(f"{'Show' if is_visible else 'Hide'} {prim.GetName()}", *paths):
            for each, token in tokens.items():
                self._author_visibility(UsdGeom.Imageable(self.stage.GetPrimAtPath(each)), token)

    def set_active(self, path: str, is_active: bool) -> None:
        """Activate or deactivate a prim and its descendants.

        Raises:
            StageError: If there is no such prim.
        """
        prim = self._prim(path)
        verb = "Activate" if is_active else "Deactivate"
        with self.step(f"{verb} {prim.GetName()}", path):
            prim.SetActive(is_active)

    def set_purpose(self, path: str, purpose: str) -> None:
        """Set a prim's purpose: default, render, proxy or guide.

        Raises:
            StageError: If there is no such prim, or it cannot have one.
            UsageError: If the purpose is unknown.
        """
        prim = self._prim(path)
        if not prim.IsA(UsdGeom.Imageable):
            raise StageError(
                path, f"a {prim.GetTypeName() or 'prim without a type'}", "an imageable prim"
            )
        known = UsdGeom.Imageable.GetOrderedPurposeTokens()
        if purpose not in known:
            raise UsageError(f"{path}.purpose", repr(purpose), f"one of {', '.join(known)}")
        with self.step(f"Make {prim.GetName()} {purpose}", f"{path}.purpose"):
            UsdGeom.Imageable(prim).CreatePurposeAttr().Set(purpose)

    def set_variant(self, path: str, variant_set: str, variant: str) -> None:
        """Select a variant; "" removes the session layer's selection.

        Raises:
            StageError: If there is no such prim or set.
            UsageError: If the set has no such variant.
        """
        sets = self._prim(path).GetVariantSets()
        if variant_set not in sets.GetNames():
            known = ", ".join(sets.GetNames()) or "none"
            raise StageError(path, f"no variant set {variant_set!r}", f"one of its sets: {known}")
        chosen = sets.GetVariantSet(variant_set)
        if variant and variant not in chosen.GetVariantNames():
            known = ", ".join(chosen.GetVariantNames())
            raise UsageError(f"{path}:{variant_set}", repr(variant), f"one of {known}")
        with self.step(f"Select {variant_set} {variant or 'as before'}", path):
            if variant:
                chosen.SetVariantSelection(variant)
            else:
                chosen.ClearVariantSelection()

    def set_transform(
        self,
        path: str,
        matrix: Matrix,
        *,
        time: float | None = None,
        is_keyed: bool = False,
        merge: str | None = None,
        verb: str = "Move",
    ) -> None:
        """Move a prim with an op on top of its own ones, described in `placing`.

        Args:
            path: Path of the prim.
            matrix: Local to world, 16 numbers, row-major, for column vectors: the result of
                `placing.transform` with the drag applied.
            time: Time at which the prim reaches the matrix; animated prims keep moving from there.
            is_keyed: Whether a time sample is authored at this time alone, rather than one value
                for all times.
            merge: As for `step`.
            verb: What the user does, for the name of the step.

        Raises:
            StageError: If there is no such prim, or it cannot be moved.
            UsageError: If the matrix has no inverse.
        """
        prim = self._prim(path)
        if not prim.IsA(UsdGeom.Xformable):
            raise StageError(
                path, f"a {prim.GetTypeName() or 'prim without a type'}", "a prim with a transform"
            )
        value = edit_of(prim, matrix, code_of(time))
        paths = (f"{path}.{EDIT}", f"{path}.xformOpOrder")
        with self.step(f"{verb} {prim.GetName()}", *paths, merge=merge):
            attribute = author_edit(prim)
            self._author(attribute, value, time if is_keyed else None)

    # --- private ---------------------------------------------------------------------------

    def _author(self, attribute: Usd.Attribute, value: Any, time: float | None) -> None:
        """Author a value on the edit target; `set_value` explains `time`."""
        spec = self.layer.GetAttributeAtPath(attribute.GetPath())
        if time is None:
            if spec is not None:
                spec.ClearInfo("timeSamples")
            attribute.Set(value)
            return
        if spec is None or not self.layer.GetNumTimeSamplesForPath(attribute.GetPath()):
            times = attribute.GetTimeSamples()[:_MOST_SAMPLES]
            for each, held in [(each, attribute.Get(each)) for each in times]:
                attribute.Set(held, each)
        attribute.Set(value, time)

    def _author_visibility(self, shown: UsdGeom.Imageable, token: str) -> None:
        """Author a visibility for all times, or nothing if weaker layers say the same."""
        attribute = shown.CreateVisibilityAttr()
        spec = self.layer.GetAttributeAtPath(attribute.GetPath())
        if spec is not None:
            self.layer.GetPrimAtPath(spec.path.GetPrimPath()).RemoveProperty(spec)
        below = shown.GetVisibilityAttr()
        if below.GetNumTimeSamples() or below.Get() != token:
            self._author(shown.CreateVisibilityAttr(), token, None)

    def _prim(self, path: str) -> Usd.Prim:
        is_path = Sdf.Path.IsValidPathString(path) and Sdf.Path(path).IsAbsoluteRootOrPrimPath()
        prim = self.stage.GetPrimAtPath(path) if is_path else None
        if not prim or prim.IsPseudoRoot():
            raise StageError(path, "no prim", "a prim of the stage")
        return prim

    def _attribute(self, path: str) -> Usd.Attribute:
        is_path = Sdf.Path.IsValidPathString(path) and Sdf.Path(path).IsPrimPropertyPath()
        attribute = self.stage.GetAttributeAtPath(path) if is_path else None
        if not attribute:
            raise StageError(path, "no attribute", "an attribute of a prim of the stage")
        return attribute

    def _editable(self, text: str) -> Sdf.Path:
        """Return the path, checked: the session layer can have opinions there."""
        path = Sdf.Path(text) if Sdf.Path.IsValidPathString(text) else Sdf.Path()
        if not path.IsAbsolutePath() or not (path.IsPrimPath() or path.IsPrimPropertyPath()):
            raise StageError(text, "no path of a prim or a property", "one")
        above = path.GetPrimPath()
        while above != Sdf.Path.absoluteRootPath:
            prim = self.stage.GetPrimAtPath(above)
            if prim and (prim.IsInstanceProxy() or prim.IsInPrototype()):
                raise StageError(text, "a prim in an instance", "one that can be edited")
            above = above.GetParentPath()
        return path


def _is_same(one: tuple[Step | None, int], other: tuple[Step | None, int]) -> bool:
    """Return whether two states of a history are the same."""
    return one[0] is other[0] and one[1] == other[1]


def _said(layer: Sdf.Layer) -> str:
    """Return what a layer says, without prims that say nothing and what a simulation added."""
    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.TransferContent(layer)
    copy.RemoveInertSceneDescription()
    copy.subLayerPaths = [
        path for path in copy.subLayerPaths if not Sdf.Layer.IsAnonymousLayerIdentifier(path)
    ]
    return str(copy.ExportToString())


def _way_out(prim: Usd.Prim, code: Usd.TimeCode) -> dict[str, str]:
    """Return the visibility of each path that must change to make a prim visible."""
    inherited, invisible = UsdGeom.Tokens.inherited, UsdGeom.Tokens.invisible
    tokens = {str(prim.GetPath()): inherited}
    child, parent = prim, prim.GetParent()
    was_hidden: list[tuple[Usd.Prim, Usd.Prim]] = []
    while parent and not parent.IsPseudoRoot():
        was_hidden.append((parent, child))
        child, parent = parent, parent.GetParent()
    hides = False
    for parent, child in reversed(was_hidden):
        imageable = UsdGeom.Imageable(parent)
        if imageable and imageable.GetVisibilityAttr().Get(code) == invisible:
            tokens[str(parent.GetPath())] = inherited
            hides = True
        if hides:
            for sibling in parent.GetChildren():
                if sibling != child and sibling.IsA(UsdGeom.Imageable):
                    tokens[str(sibling.GetPath())] = invisible
    return tokens
