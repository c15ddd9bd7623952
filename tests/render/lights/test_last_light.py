"""Tests of pictures that show the last light instead of waiting for their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.lights.test_relit import ball
from tests.render.lights.test_shadows import SUN, dimmed_scene, view_from_above
from tests.render.rendering import settings_of
from usdsplat.kernels.devices import open_device
from usdsplat.render.patience import Patience
from usdsplat.render.renderer import Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import FieldSpec, InstanceSpec

SQUARE = tuple(np.eye(4).ravel())


def drawn(renderer, scene, name, *, light, **settings):
    """One AOV of a picture, and whether the picture lacks its light."""
    bands = renderer.render(
        scene, view_from_above(), settings_of(**settings), (name,), patience=Patience(light=light)
    )
    found = np.concatenate([band.arrays[name].copy() for band in bands])
    return found, renderer.stats.lacks_light


def test_irradiance_is_no_last_light_of_a_shadow():
    """Oracle: the shadow of the picture that waits, bit for bit, after it; before it, the picture
    says that it lacks its light."""
    scene, renderer = dimmed_scene(), Renderer(open_device())
    drawn(renderer, scene, "irradiance", light=True)
    _, lacks_light = drawn(renderer, scene, "shadow", light=False)
    assert lacks_light
    expected, _ = drawn(renderer, scene, "shadow", light=True)
    assert expected.min() < 0.8
    found, lacks_light = drawn(renderer, scene, "shadow", light=False)
    np.testing.assert_array_equal(found, expected)
    assert not lacks_light


@pytest.mark.parametrize("aov", ["depth", "albedo", "Neye", "primId", "depthFront"])
def test_what_light_does_not_change_is_drawn_without_computing_it(aov):
    """Oracle: the pixels of the picture with captured colours, and the statistics; colour of the
    same renderer has its light."""
    scene, renderer = dimmed_scene(), Renderer(open_device())
    expected, _ = drawn(Renderer(open_device()), scene, aov, light=True)
    found, lacks_light = drawn(renderer, scene, aov, light=True, lighting="shadowed")
    np.testing.assert_array_equal(found, expected)
    assert renderer.stats.light_steps == 0 and not lacks_light
    assert not drawn(renderer, scene, aov, light=False, lighting="shadowed")[1]
    drawn(renderer, scene, "color", light=True, lighting="shadowed")
    assert renderer.stats.light_steps > 0


@pytest.mark.parametrize("edit", ["color space", "normals"])
def test_an_edit_that_changes_relit_colours_is_lacking_until_its_light_is_computed(edit):
    """Oracle: the picture of a new renderer, bit for bit, once there is no more waiting."""
    cloud, surface = ball()
    scene, renderer = RenderScene(), Renderer(open_device())
    before = FieldSpec(cloud=cloud, surface=surface, color_space="srgb_rec709_scene")
    turned = replace(surface, normals=np.ascontiguousarray(surface.normals[:, [1, 2, 0]]))
    changes = {"color space": {"color_space": "lin_rec709_scene"}, "normals": {"surface": turned}}
    scene.set_field("/ball", before)
    scene.set_instances("/ball", (InstanceSpec(path="/ball", transform=SQUARE),))
    scene.set_light("/sun", SUN)
    first, _ = drawn(renderer, scene, "color", light=True, lighting="relit")
    assert not drawn(renderer, scene, "color", light=False, lighting="relit")[1]
    scene.set_field("/ball", replace(before, **changes[edit]))
    assert drawn(renderer, scene, "color", light=False, lighting="relit")[1]
    found, _ = drawn(renderer, scene, "color", light=True, lighting="relit")
    fresh, _ = drawn(Renderer(open_device()), scene, "color", light=True, lighting="relit")
    np.testing.assert_array_equal(found, fresh)
    assert np.abs(found - first).max() > 0.01
