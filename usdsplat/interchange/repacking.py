"""Convert the splat fields of a stage to another storage form."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from pxr import Usd

from usdsplat.core.edits import Edit
from usdsplat.core.errors import UsageError
from usdsplat.core.findings import Finding
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange import files
from usdsplat.interchange.field_writing import FieldWriter
from usdsplat.interchange.flattening import flattened
from usdsplat.interchange.repacking_in_place import converted_root
from usdsplat.interchange.reports import RepackReport
from usdsplat.schema import Form
from usdsplat.schema.composition import composition_findings


def repack(
    source: Path | str | Usd.Stage,
    target: Path | str,
    *,
    form: Form,
    edits: Sequence[Edit] = (),
    flatten: bool = False,
    progress: Progress = silent,
) -> RepackReport:
    """Write a stage with all splat fields in `form`; time samples are kept.

    The file is a copy of the stage's root layer with converted fields, in each variant. References,
    payloads, sublayers, variants and asset information stay; fields of referenced files become
    opinions over them. Fields that already have the form are copied unchanged, unless they are
    edited; so is a field whose data differs between the variants of a set and no selection, if none
    is selected, which is a finding.

    Args:
        source: A USD file, or a stage, which is not modified. Its session layer is not written,
            unless it is flattened.
        target: A .usd, .usda, .usdc or .usdz file, replaced when the new one is complete.
        form: "float", "half" or "packed", see `schema.author`.
        edits: Edits in order, of every field and sample, in the field's own coordinates.
        flatten: Whether to write one self-contained layer, with the selected variants only.
        progress: Receives the progress of clouds and of writing.

    Raises:
        UsageError: If `form` is unknown, a number exceeds its range, edits leave no splat of a
            field, or an edit needs a static field.
        StageError: If the source cannot be opened or has no splat field.
        OutputError: If the target cannot be written, or is a file of the source.
    """
    path = Path(target)
    files.check_suffix(path)
    if form not in get_args(Form):
        raise UsageError("form", repr(form), f"one of {', '.join(get_args(Form))}")
    stage = source if isinstance(source, Usd.Stage) else files.open_stage(Path(source))
    files.check_not_input(path, files.layer_files(stage))
    writer = FieldWriter(form, edits, progress)
    findings: list[Finding] = composition_findings(stage)
    if flatten:
        layer = flattened(stage, _name(source), writer)
    else:
        layer, missed = converted_root(stage, path, writer)
        findings += missed
    progress.step("repacking", writer.samples, writer.samples)
    files.save(layer, path)
    return RepackReport(
        source=_name(source),
        target=str(path),
        prim_paths=tuple(writer.paths),
        variants=writer.variants,
        samples=writer.samples,
        splats=writer.splats,
        form=form,
        notes=tuple(writer.notes),
        findings=tuple(findings),
    )


def _name(source: Path | str | Usd.Stage) -> str:
    """Return the name of a source."""
    return str(source.GetRootLayer().identifier if isinstance(source, Usd.Stage) else source)
