"""Stages of the same layers as another one, with a session of their own."""

from __future__ import annotations

from collections.abc import Sequence

from pxr import Sdf, Usd


def twin(
    stage: Usd.Stage, without: Sequence[str] = (), weaker: Sdf.Layer | None = None
) -> Usd.Stage:
    """Return another stage with the same layers and a copy of the session layer.

    Args:
        stage: The stage; the caller holds its lock.
        without: Identifiers of sublayers of the session layer to leave out.
        weaker: Layer to add below these sublayers.
    """
    session = Sdf.Layer.CreateAnonymous("twin.usda")
    session.TransferContent(stage.GetSessionLayer())
    kept = [path for path in session.subLayerPaths if path not in without]
    session.subLayerPaths = kept if weaker is None else [*kept, weaker.identifier]
    made = Usd.Stage.OpenMasked(
        stage.GetRootLayer(),
        session,
        stage.GetPathResolverContext(),
        stage.GetPopulationMask(),
        Usd.Stage.LoadNone,
    )
    made.SetLoadRules(stage.GetLoadRules())
    made.MuteAndUnmuteLayers(stage.GetMutedLayers(), [])
    made.SetInterpolationType(stage.GetInterpolationType())
    return made


def over_captures(stage: Usd.Stage, layer: Sdf.Layer) -> Usd.Stage:
    """Return another stage with the same layers, and one more below those of its session."""
    return twin(stage, weaker=layer)


def in_session(stage: Usd.Stage, layer: Sdf.Layer) -> Usd.Stage:
    """Add a layer below those of a stage's session, and return the stage."""
    stage.GetSessionLayer().subLayerPaths.append(layer.identifier)
    return stage


def leave_session(stage: Usd.Stage, layer: Sdf.Layer) -> None:
    """Remove what `in_session` added."""
    session = stage.GetSessionLayer()
    if layer.identifier in list(session.subLayerPaths):
        session.subLayerPaths.remove(layer.identifier)
