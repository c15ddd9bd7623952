"""Acceptance: products of a stage as Solaris exports it, read back by three readers of EXR."""

from __future__ import annotations

import json
import struct

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.cli.conftest import ball
from tests.images.exr_file import ExrFile
from tests.products import reprojection
from usdsplat import main, schema

pytestmark = pytest.mark.usefixtures("compiled")

EMPTY = 2**32 - 1
FRAMES = (1001, 1002)

RENDER = """#usda 1.0
(
    subLayers = [@world.usda@]
    renderSettingsPrimPath = "/Render/rendersettings"
    startTimeCode = 1001
    endTimeCode = 1002
    framesPerSecond = 23.976
    timeCodesPerSecond = 23.976
    metersPerUnit = 0.01
    upAxis = "Y"
)

def Scope "Render"
{
    def RenderSettings "rendersettings"
    {
        rel camera = </cameras/main>
        rel products = [
            </Render/Products/beauty>, </Render/Products/data>, </Render/Products/deep>,
            </Render/Products/proof>,
        ]
        int2 resolution = (60, 40)
        token aspectRatioConformPolicy = "expandAperture"
        float4 dataWindowNDC = (0, 0, 1, 1)
        token[] includedPurposes = ["default", "render"]
        custom string splat:startTimecode = "01:00:00:00"
    }

    def Scope "Products"
    {
        def RenderProduct "beauty"
        {
            string driver:parameters:artist = "Ada"
            string driver:parameters:comment = ""
            string driver:parameters:OpenEXR:shot = "sq010"
            string driver:parameters:OpenEXR:compression = "none"
            rel orderedVars = [
                </Render/Products/Vars/Beauty>, </Render/Products/Vars/Alpha>,
                </Render/Products/Vars/Depth>, </Render/Products/Vars/Crypto>,
            ]
            token productName.timeSamples = {
                1001: "render/beauty.1001.exr",
                1002: "render/beauty.1002.exr",
            }
            token productType = "raster"
        }

        def RenderProduct "data"
        {
            rel orderedVars = [
                </Render/Products/Vars/Beauty>, </Render/Products/Vars/P>,
                </Render/Products/Vars/Id>, </Render/Products/Vars/Instance>,
            ]
            token productName = "render/$F4/data.$F4.exr"
            custom bool splat:multipart = 1
            float4 dataWindowNDC = (-0.1, -0.1, 1.1, 1.1)
        }

        def RenderProduct "deep"
        {
            rel orderedVars = [</Render/Products/Vars/Beauty>, </Render/Products/Vars/Depth>]
            token productName = "render/deep.<F4>.exr"
            token productType = "deepRaster"
        }

        def RenderProduct "proof"
        {
            rel orderedVars = </Render/Products/Vars/Beauty>
            token productName = "render/proof.$F4.png"
            int2 resolution = (30, 20)
            custom token splat:pngBits = "16"
        }

        def Scope "Vars"
        {
            def RenderVar "Beauty"
            {
                token dataType = "color4f"
                token driver:parameters:aov:format = "color4h"
                string driver:parameters:aov:name = "C"
                string sourceName = "Ci"
            }

            def RenderVar "Alpha"
            {
                token dataType = "float"
                string sourceName = "a"
            }

            def RenderVar "Depth"
            {
                token dataType = "float"
                string sourceName = "depth"
            }

            def RenderVar "Crypto"
            {
                token dataType = "float"
                string sourceName = "cryptoObject"
            }

            def RenderVar "P"
            {
                token dataType = "vector3f"
                string sourceName = "P"
            }

            def RenderVar "Id"
            {
                token dataType = "int"
                string sourceName = "primId"
            }

            def RenderVar "Instance"
            {
                token dataType = "int"
                string sourceName = "instanceId"
            }
        }
    }
}
"""


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """The folder of the products of two frames: a ball that hides at the second, and instances."""
    folder = tmp_path_factory.mktemp("solaris")
    stage = Usd.Stage.CreateNew(str(folder / "world.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(23.976)  # else USD scales the times of this sublayer
    prim = schema.author(stage, "/world/ball", ball())
    seen = UsdGeom.Imageable(prim).GetVisibilityAttr()
    seen.Set("inherited", 1001)
    seen.Set("invisible", 1002)
    instancer = UsdGeom.PointInstancer.Define(stage, "/world/scatter")
    leaf = UsdGeom.Sphere.Define(stage, "/world/scatter/leaf")
    leaf.GetRadiusAttr().Set(0.2)
    instancer.CreatePrototypesRel().SetTargets([leaf.GetPath()])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(-0.8, 0, 0), (0.8, 0, 0)])
    hidden = instancer.CreateInvisibleIdsAttr()
    hidden.Set([], 1001)
    hidden.Set([0], 1002)
    camera = UsdGeom.Camera.Define(stage, "/cameras/main")
    camera.AddTranslateOp().Set(Gf.Vec3d(0.2, 0.1, 4))
    camera.GetHorizontalApertureOffsetAttr().Set(1.5)
    camera.GetClippingRangeAttr().Set(Gf.Vec2f(0.1, 100))
    stage.GetRootLayer().Save()
    (folder / "shot.usda").write_text(RENDER)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.delenv("OCIO", raising=False)
        assert main(["render", "shot.usda", "--strict", "--no-compare"]) == 0
    return folder / "render"


def test_the_files_are_those_that_the_stage_names(rendered):
    """Oracle: the names authored above, with the frame as Houdini writes it."""
    found = sorted(str(path.relative_to(rendered)) for path in rendered.rglob("*.*"))
    assert found == sorted(
        name
        for frame in FRAMES
        for name in (
            f"beauty.{frame}.exr", f"{frame}/data.{frame}.exr", f"deep.{frame}.exr",
            f"proof.{frame}.png",
        )
    )  # fmt: skip


@pytest.mark.parametrize("frame", FRAMES)
def test_three_readers_agree_on_the_beauty(rendered, frame):
    """Oracle: OpenEXR, OpenImageIO, and `ExrFile`, written from the description of the layout."""
    file = rendered / f"beauty.{frame}.exr"
    own = ExrFile(file)
    (_, channels), *others = own.parts
    assert not others
    kinds = {name: channels[name].dtype for name in ("R", "G", "B", "A", "Z")}
    assert kinds == {**dict.fromkeys("RGB", np.float16), "A": np.float32, "Z": np.float32}
    part = OpenEXR.File(str(file), separate_channels=True).parts[0]
    assert set(part.channels) == set(channels)
    image = oiio.ImageBuf(str(file)).get_pixels(oiio.FLOAT)
    names = oiio.ImageBuf(str(file)).spec().channelnames
    for name, values in channels.items():
        np.testing.assert_array_equal(part.channels[name].pixels, values)
        np.testing.assert_array_equal(image[..., names.index(name)], values.astype(np.float32))
    assert (channels["A"] > 0.5).sum() > 20
    assert (np.isinf(channels["Z"]) == (channels["A"] == 0)).mean() > 0.9


@pytest.mark.parametrize(("frame", "frames"), [(1001, 0), (1002, 1)])
def test_headers_have_time_and_entries_of_the_product(rendered, frame, frames):
    """Oracle: OpenEXR's reader; the stage's start and rate, and what Solaris authored."""
    header = OpenEXR.File(str(rendered / f"beauty.{frame}.exr"), header_only=True).header()
    code = header["timeCode"]
    assert (code.hours, code.minutes, code.seconds, code.frame) == (1, 0, 0, frames)
    assert str(header["framesPerSecond"]) == "24000/1001"
    assert (header["artist"], header["shot"]) == ("Ada", "sq010")
    assert "comment" not in header
    assert header["usdsplat:frame"] == frame


def test_ids_name_prims_and_instances_on_every_frame(rendered):
    """Oracle: visibility and invisibleIds as authored; OpenImageIO's reader of the ids."""
    expected = {
        1001: {("/world/ball", 0), ("/world/scatter/leaf", 0), ("/world/scatter/leaf", 1)},
        1002: {("/world/scatter/leaf", 1)},
    }
    for frame, pairs in expected.items():
        image = oiio.ImageInput.open(str(rendered / str(frame) / f"data.{frame}.exr"))
        parts = 0
        while image.seek_subimage(parts, 0):
            parts += 1
        image.seek_subimage(parts - 1, 0)
        spec = image.spec()
        table = json.loads(spec.getattribute("usdsplat:ids"))
        assert table == ["/world/ball", "/world/scatter/leaf"]
        pixels = image.read_image(parts - 1, 0, 0, 2, "uint").reshape(-1, 2).tolist()
        image.close()
        columns = [spec.channelnames.index(name) for name in ("id", "instanceId")]
        found = {tuple(row[column] for column in columns) for row in pixels}
        assert {(table[prim], each) for prim, each in found if prim != EMPTY} == pairs


def test_positions_fall_on_their_pixels_in_an_overscan(rendered):
    """Oracle: `reprojection`, by OpenEXR's reader: each part has the camera."""
    file = OpenEXR.File(str(rendered / "1001" / "data.1001.exr"), separate_channels=True)
    parts = {part.header["name"]: part for part in file.parts}
    header = parts["P"].header
    (x0, y0), (x1, y1) = header["dataWindow"]
    assert (x0, y0, x1, y1) == (-6, -4, 65, 43)
    channels = {name: each.pixels for name, each in parts["P"].channels.items()}
    is_seen = parts["rgba"].channels["A"].pixels > 0.5
    for project in (reprojection.to_pixels, reprojection.through_nuke):
        x, y = project(header, reprojection.positions(channels))
        across, down = reprojection.centres(header)
        assert np.hypot(x - across, y - down)[is_seen].max() < 2e-3


def test_the_manifest_names_what_the_mattes_hold(rendered):
    """Oracle: the ranks of `ExrFile`'s channels, by the manifest of OpenEXR's header."""
    for frame, names in ((1001, {"/world/ball", "/world/scatter/leaf"}), (1002, None)):
        file = rendered / f"beauty.{frame}.exr"
        header = OpenEXR.File(str(file), header_only=True).header()
        (key,) = (name for name in header if name.endswith("/manifest"))
        manifest = {int(text, 16): name for name, text in json.loads(header[key]).items()}
        channels = ExrFile(file).parts[0][1]
        bits = {
            struct.unpack("<I", struct.pack("<f", value))[0]
            for value in np.unique(channels["cryptoObject00.R"])
        }
        assert {manifest[each] for each in bits - {0}} == (names or {"/world/scatter/leaf"})


def test_deep_and_proof_are_of_the_same_picture(rendered):
    """Oracle: OpenImageIO's flattening against the beauty; the proof's size and type."""
    for frame in FRAMES:
        flat = oiio.ImageBufAlgo.flatten(oiio.ImageBuf(str(rendered / f"deep.{frame}.exr")))
        alpha = flat.get_pixels(oiio.FLOAT)[..., flat.spec().channelnames.index("A")]
        beauty = ExrFile(rendered / f"beauty.{frame}.exr").parts[0][1]["A"]
        np.testing.assert_allclose(alpha, beauty, atol=5e-3)
        proof = oiio.ImageBuf(str(rendered / f"proof.{frame}.png")).spec()
        assert (proof.width, proof.height, str(proof.format)) == (30, 20, "uint16")
