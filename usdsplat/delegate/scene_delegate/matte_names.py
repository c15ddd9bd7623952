"""Find the asset and the material of prims, by which Cryptomatte groups them."""

from __future__ import annotations

from pxr import Kind, Sdf, Usd

from usdsplat.delegate.scene_delegate.bindings import BINDING, computed_material


class MatteNames:
    """Paths of assets and materials, cached by prim for one traversal of a stage."""

    def __init__(self) -> None:
        self._assets: dict[Sdf.Path, tuple[str, str]] = {}
        self._binds: dict[Sdf.Path, bool] = {}
        self._first: dict[Sdf.Path, str] = {}

    def asset(self, prim: Usd.Prim) -> str:
        """Return the path of a prim's asset.

        It is the nearest component model at or above the prim, judged by `kind` alone, because many
        stages have no complete model hierarchy. Without one, it is the nearest prim with a name or
        an identifier in `assetInfo`, and without such a prim the root prim.
        """
        component, informed = self._asset(prim)
        return component or informed or str(prim.GetPath().GetPrefixes()[0])

    def material(self, prim: Usd.Prim) -> str:
        """Return the path of the bound material; "" without one.

        A material inside native instances is later named by its path in the first of them, see
        `named`.
        """
        material = computed_material(prim) if self._is_bound(prim) else None
        if material is None:
            return ""
        path = str(material.GetPath())
        if material.IsInstanceProxy():
            source = material.GetPrimInPrototype().GetPath()
            self._first[source] = min(path, self._first.get(source, path))
        return path

    def named(self, stage: Usd.Stage, path: str) -> str:
        """Return the path by which a result of `material` is named."""
        if not self._first or not path:
            return path
        prim = stage.GetPrimAtPath(path)
        is_proxy = prim.IsInstanceProxy()
        return self._first[prim.GetPrimInPrototype().GetPath()] if is_proxy else path

    # --- private ---------------------------------------------------------------------------

    def _asset(self, prim: Usd.Prim) -> tuple[str, str]:
        """Return the paths of the nearest component and of the nearest prim with `assetInfo`, ""
        where there is none."""
        path = prim.GetPath()
        if path == Sdf.Path.absoluteRootPath:
            return "", ""
        if path not in self._assets:
            component, informed = self._asset(prim.GetParent())
            model = Usd.ModelAPI(prim)
            if Kind.Registry.IsA(model.GetKind(), Kind.Tokens.component):
                component = str(path)
            if model.GetAssetName() or model.GetAssetIdentifier().path:
                informed = str(path)
            self._assets[path] = component, informed
        return self._assets[path]

    def _is_bound(self, prim: Usd.Prim) -> bool:
        """Return whether the prim or one of its ancestors has a binding."""
        path = prim.GetPath()
        if path == Sdf.Path.absoluteRootPath:
            return False
        if path not in self._binds:
            own = any(name.startswith(BINDING) for name in prim.GetAuthoredPropertyNames())
            self._binds[path] = own or self._is_bound(prim.GetParent())
        return self._binds[path]
