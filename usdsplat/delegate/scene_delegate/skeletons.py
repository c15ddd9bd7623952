"""Find the UsdSkel skins of meshes, and record their sources."""

from __future__ import annotations

from pxr import Sdf, Usd, UsdSkel

from usdsplat.delegate.scene_delegate.readings import Sources
from usdsplat.schema.skin import Bound, Skin

INSTANCES = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


class Skeletons:
    """Cache of UsdSkel bindings of a stage; must be cleared after any edit."""

    def __init__(self) -> None:
        self._cache = UsdSkel.Cache()
        self._bound: dict[Sdf.Path, dict[Sdf.Path, Bound]] = {}

    def clear(self) -> None:
        """Clear the cache."""
        self._cache.Clear()
        self._bound.clear()

    def skin(self, prim: Usd.Prim, sources: Sources) -> Skin | None:
        """Return the skin of `prim`, or None; record all sources that move its points."""
        skeleton = _inherited(prim, UsdSkel.Tokens.skelSkeleton, sources)
        if skeleton:
            _note(skeleton, sources)
            if animation := _inherited(skeleton, UsdSkel.Tokens.skelAnimationSource, sources):
                sources.add(animation)
        sources.targets(prim, UsdSkel.Tokens.skelBlendShapeTargets)
        return self._find(prim)

    def frame(self, prim: Usd.Prim, sources: Sources) -> Usd.Prim:
        """Return the prim whose transform applies: the skeleton if joints move `prim`, else
        itself."""
        skeleton = _inherited(prim, UsdSkel.Tokens.skelSkeleton, sources)
        skin = self._find(prim)
        if skeleton is None or skin is None or not skin.has_joints:
            return prim
        sources.place(skeleton)
        return skeleton

    def _find(self, prim: Usd.Prim) -> Skin | None:
        root = UsdSkel.Root.Find(prim)
        found = self._in(root).get(prim.GetPath()) if root else None
        return Skin(*found) if found else None

    def _in(self, root: UsdSkel.Root) -> dict[Sdf.Path, Bound]:
        """Return the skinned prims below a SkelRoot."""
        path = root.GetPath()
        if path not in self._bound:
            self._cache.Populate(root, INSTANCES)
            found = {}
            for binding in self._cache.ComputeSkelBindings(root, INSTANCES):
                skeleton = self._cache.GetSkelQuery(binding.GetSkeleton())
                for skin in binding.GetSkinningTargets():
                    found[skin.GetPrim().GetPath()] = (skeleton, skin)
            self._bound[path] = found
        return self._bound[path]


def _inherited(prim: Usd.Prim, name: str, sources: Sources) -> Usd.Prim | None:
    """Return the target of a relationship of the prim or its nearest ancestor that has one."""
    while prim and not prim.IsPseudoRoot():
        relationship = prim.GetRelationship(name)
        if relationship and relationship.HasAuthoredTargets():
            targets = sources.targets(prim, name)
            found = sources.follow(targets[0]) if targets else None
            return found if found else None
        prim = prim.GetParent()
    return None


def _note(prim: Usd.Prim, sources: Sources) -> None:
    """Record a prim and its ancestors as sources."""
    while prim and not prim.IsPseudoRoot():
        sources.add(prim)
        prim = prim.GetParent()
