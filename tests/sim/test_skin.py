"""Tests of skinned splats."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel

from tests.sim.shapes import sheet, sphere
from usdsplat.core import quaternion
from usdsplat.core.errors import StageError
from usdsplat.kernels.devices import open_device
from usdsplat.sim.parameters import SkinParameters
from usdsplat.sim.skin import Skin
from usdsplat.sim.specs import SkinBinding, SkinPose, Surface

METHODS = ("linear", "dualQuaternion")


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


def rigid(rng):
    """A rotation and a translation as a matrix."""
    out = np.eye(4)
    turn = quaternion.normalize(rng.normal(size=(1, 4)))
    out[:3, :3], out[:3, 3] = quaternion.to_matrix(turn)[0], rng.normal(size=3)
    return out


def bound(indices, weights, bind=None):
    return SkinBinding(
        indices=np.array(indices, np.int32),
        weights=np.array(weights, np.float32),
        bind=np.eye(4) if bind is None else bind,
    )


def moved(device, binding, pose, points, /, **options):
    """Positions and gradient of a new skin."""
    parameters = SkinParameters(**options)
    positions = points.copy()
    gradient = np.tile(np.eye(3, dtype=np.float32), (len(points), 1, 1))
    Skin(device, binding, points, parameters).apply(pose, parameters, positions, gradient)
    return positions, gradient


@pytest.mark.parametrize("method", METHODS)
def test_all_weights_on_one_joint_are_the_joints_transform(device, method):
    """Oracle: the matrix itself, with a stretch; what came before is multiplied from the left."""
    rng = np.random.default_rng(0)
    n = 3000
    points = rng.normal(0, 2, (n, 3)).astype(np.float32)
    bind, joints = rigid(rng), np.stack([rigid(rng), rigid(rng)])
    joints[1, :3, :3] *= 1.7
    joints[1, :3, 0] *= -0.5
    before = rng.normal(0, 1, (n, 3, 3)).astype(np.float32)
    binding = bound(np.tile([0, 1], (n, 1)), np.tile([0, 1], (n, 1)), bind)
    parameters = SkinParameters(method=method)
    positions, gradient = points.copy(), before.copy()
    skin = Skin(device, binding, points, parameters)
    skin.apply(SkinPose(joints=joints), parameters, positions, gradient)
    move = joints[1] @ bind
    expected = points @ move[:3, :3].T + move[:3, 3]
    assert np.abs(positions - expected).max() <= 1e-5 * np.abs(expected).max()
    slopes = move[:3, :3] @ before
    assert np.abs(gradient - slopes).max() <= 1e-5 * np.abs(slopes).max()


@pytest.mark.parametrize("name, tolerance", [("lbs", 1e-6), ("dqs", 1e-5)])
def test_points_go_where_openusd_takes_them(device, name, tolerance, data):
    """Oracle: OpenUSD's published bake and its own UsdSkelSkinningQuery, frame by frame."""
    folder = data / "usd/openusd/skelBake"
    stage = Usd.Stage.Open(str(folder / f"{name}.usda"))
    baked = Usd.Stage.Open(str(folder / f"{name}.baked.usda"))
    cache = UsdSkel.Cache()
    root = UsdSkel.Root(stage.GetPrimAtPath("/Root"))
    cache.Populate(root, Usd.PrimDefaultPredicate)
    (found,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(found.GetSkeleton())
    checked = 0
    for target in found.GetSkinningTargets():
        path = str(target.GetPrim().GetPath())
        if path.rsplit("/", 1)[1] not in ("Mesh", "Curves"):
            continue
        rest = np.array(UsdGeom.PointBased(target.GetPrim()).GetPointsAttr().Get())
        indices, weights = target.ComputeVaryingJointInfluences(len(rest))
        bind = np.array(target.GetGeomBindTransform()).T
        binding = bound(
            np.array(indices).reshape(len(rest), -1), np.array(weights).reshape(len(rest), -1), bind
        )
        for time in (1, 5, 10, 20, 30):
            joints = query.ComputeSkinningTransforms(time)
            pose = SkinPose(joints=np.array(joints).swapaxes(1, 2))
            method = dict(zip(("lbs", "dqs"), METHODS, strict=True))[name]
            positions, _ = moved(device, binding, pose, rest, method=method)
            oracle = UsdGeom.PointBased(stage.GetPrimAtPath(path)).GetPointsAttr().Get()
            assert target.ComputeSkinnedPoints(joints, oracle, time)
            assert np.abs(positions - np.array(oracle)).max() <= tolerance
            if path.endswith("/Mesh"):
                bake = UsdGeom.PointBased(baked.GetPrimAtPath(path)).GetPointsAttr().Get(time)
                assert np.abs(positions - np.array(bake)).max() <= 1e-5
            checked += 1
    assert checked == 10


@pytest.mark.parametrize("amount", [1.0, 0.4])
def test_the_gradient_is_the_derivative_where_weights_are_constant(device, amount):
    """Oracle: central differences of the positions in float64 steps of 1/64."""
    rng = np.random.default_rng(1)
    n, step = 200, 1 / 64
    points = rng.normal(0, 1, (n, 3)).astype(np.float32)
    joints = np.stack([rigid(rng) for _ in range(5)])
    indices = rng.integers(0, 5, (n, 3))
    weights = rng.dirichlet([1, 1, 1], n)
    for method in METHODS:
        options = {"method": method, "weight": amount}
        binding, pose = bound(indices, weights, rigid(rng)), SkinPose(joints=joints)
        _, gradient = moved(device, binding, pose, points, **options)
        for axis in range(3):
            shift = np.zeros(3, np.float32)
            shift[axis] = step
            ahead, _ = moved(device, binding, pose, points + shift, **options)
            behind, _ = moved(device, binding, pose, points - shift, **options)
            slope = (ahead.astype(np.float64) - behind) / (2 * step)
            assert np.abs(slope - gradient[:, :, axis]).max() <= 1e-4
        if method == "dualQuaternion":
            squares = gradient.swapaxes(1, 2) @ gradient
            assert np.abs(squares - np.eye(3)).max() <= 1e-5, "rigid joints blend to rotations"


def test_half_a_turn_keeps_its_size_by_dual_quaternions_only(device):
    """Oracle: closed form: linear skinning of 0 and 180 degrees collapses (the candy wrapper);
    dual quaternions give 90."""
    joints = np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])])
    points = np.array([[1, 0, 0]], np.float32)
    binding, pose = bound([[0, 1]], [[0.5, 0.5]]), SkinPose(joints=joints)
    linear, _ = moved(device, binding, pose, points, method="linear")
    dual, _ = moved(device, binding, pose, points, method="dualQuaternion")
    assert np.abs(linear).max() <= 1e-6
    assert np.abs(np.abs(dual) - [[0, 1, 0]]).max() <= 1e-6


def test_weight_zero_and_no_joints_leave_splats_as_they_are(device):
    """Oracle: bits."""
    rng = np.random.default_rng(2)
    points = rng.normal(0, 1, (50, 3)).astype(np.float32)
    pose = SkinPose(joints=np.stack([rigid(rng)]))
    for weights, amount in ((np.ones((50, 1)), 0.0), (np.zeros((50, 1)), 1.0)):
        for method in METHODS:
            binding = bound(np.zeros((50, 1)), weights)
            positions, gradient = moved(device, binding, pose, points, method=method, weight=amount)
            assert np.array_equal(positions, points)
            assert np.array_equal(gradient, np.tile(np.eye(3), (50, 1, 1)))


def test_joints_are_taken_from_the_closest_place_of_a_mesh(device):
    """Oracle: the same in float64 with dictionaries; the strongest eight, ties by number."""
    rng = np.random.default_rng(3)
    surface = sheet(6)
    p = len(surface.points)
    indices = rng.integers(0, 40, (p, 5)).astype(np.int32)
    weights = rng.dirichlet([1] * 5, p).astype(np.float32)
    bind = np.eye(4)
    bind[:3, 3] = (0.5, 0, 2)
    at_bind = np.concatenate([rng.uniform(-1, 1, (300, 2)), np.zeros((300, 1))], axis=1)
    points = (at_bind - bind[:3, 3]).astype(np.float32)
    binding = SkinBinding(
        indices=None, weights=None, bind=bind, surface=surface,
        surface_indices=indices, surface_weights=weights,
    )  # fmt: skip
    memory = Skin(device, binding, points, SkinParameters()).memory()
    assert memory["joints"].shape == (300, 8)
    corners = surface.points.astype(np.float64)[surface.triangles]
    for row in range(300):
        system = np.concatenate([corners.swapaxes(1, 2)[:, :2], np.ones((len(corners), 1, 3))], 1)
        target = np.array([*at_bind[row, :2], 1.0])
        places = np.linalg.solve(system, np.tile(target, (len(corners), 1))[..., None])[..., 0]
        face = np.argmax(places.min(axis=1))
        shares: dict[int, float] = {}
        for vertex, place in zip(surface.triangles[face], places[face], strict=True):
            for joint, weight in zip(indices[vertex], weights[vertex], strict=True):
                shares[joint] = shares.get(joint, 0) + place * float(weight)
        best = sorted(shares.values(), reverse=True)[:8]
        found = memory["weights"][row]
        assert np.abs(found - np.array(best) / sum(best)).max() <= 1e-5
        for joint, weight in zip(memory["joints"][row], found, strict=True):
            assert abs(shares[joint] / sum(best) - weight) <= 1e-5


def test_splats_on_triangles_ride_a_mesh_exactly(device):
    """Oracle: the affine map that moves the mesh: similarities everywhere; any affine map for
    splats in the triangles' planes."""
    rng = np.random.default_rng(4)
    surface = sphere(3)
    points = rng.normal(0, 1, (500, 3)).astype(np.float32)
    binding = SkinBinding(indices=None, weights=None, bind=np.eye(4), surface=surface)
    move = rigid(rng)
    move[:3, :3] *= 1.6
    after = (surface.points @ move[:3, :3].T + move[:3, 3]).astype(np.float32)
    pose = SkinPose(
        joints=np.zeros((0, 4, 4)), surface=Surface(points=after, triangles=surface.triangles)
    )
    positions, gradient = moved(device, binding, pose, points, binding="triangles")
    assert np.abs(positions - (points @ move[:3, :3].T + move[:3, 3])).max() <= 1e-5
    assert np.abs(gradient - move[:3, :3]).max() <= 1e-4
    flat = sheet(5)
    points = np.concatenate([rng.uniform(-1, 1, (100, 2)), np.zeros((100, 1))], axis=1)
    points = points.astype(np.float32)
    shear = rng.normal(0, 1, (3, 3))
    after = (flat.points @ shear.T).astype(np.float32)
    binding = SkinBinding(indices=None, weights=None, bind=np.eye(4), surface=flat)
    pose = SkinPose(
        joints=np.zeros((0, 4, 4)), surface=Surface(points=after, triangles=flat.triangles)
    )
    positions, gradient = moved(device, binding, pose, points, binding="triangles")
    assert np.abs(positions - points @ shear.T).max() <= 1e-5
    assert np.abs(gradient[:, :, :2] - shear[:, :2]).max() <= 1e-4


def test_children_follow_what_their_parents_do(device):
    """Oracle: the parents' own joints, by hand, in positions of the children's own."""
    rng = np.random.default_rng(5)
    points = rng.normal(0, 1, (40, 3)).astype(np.float32)
    joints = np.stack([rigid(rng) for _ in range(4)])
    indices = rng.integers(0, 4, (40, 1))
    skin = Skin(device, bound(indices, np.ones((40, 1))), points, SkinParameters())
    parents = np.array([3, 3, 17])
    children = rng.normal(0, 1, (3, 3)).astype(np.float32)
    more = skin.extended(parents)
    assert len(skin) == 40 and len(more) == 43
    positions = np.concatenate([points, children])
    more.apply(SkinPose(joints=joints), SkinParameters(), positions)
    moves = joints[indices[parents, 0]]
    expected = np.einsum("nij,nj->ni", moves[:, :3, :3], children) + moves[:, :3, 3]
    assert np.abs(positions[40:] - expected).max() <= 1e-5
    again = skin.selected(np.arange(43) % 40)
    again.restore(more.memory())
    repeated = np.concatenate([points, children])
    again.apply(SkinPose(joints=joints), SkinParameters(), repeated)
    assert np.array_equal(repeated, positions)


def test_skins_have_the_same_bits_on_any_number_of_threads():
    """Oracle: one thread."""
    rng = np.random.default_rng(6)
    points = rng.normal(0, 1, (5000, 3)).astype(np.float32)
    pose = SkinPose(joints=np.stack([rigid(rng) for _ in range(6)]))
    binding = bound(rng.integers(0, 6, (5000, 4)), rng.dirichlet([1] * 4, 5000))
    for method in METHODS:
        one, two = (
            moved(open_device(threads=threads), binding, pose, points, method=method)
            for threads in (1, 2)
        )
        assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def test_what_cannot_be_followed_is_one_sentence(device):
    """Oracle: the sentences."""
    points = np.zeros((4, 3), np.float32)
    surface = sheet(2)
    nothing = SkinBinding(indices=None, weights=None, bind=np.eye(4))
    bare = SkinBinding(indices=None, weights=None, bind=np.eye(4), surface=surface)
    for binding, said in (
        (nothing, "neither joint weights nor a mesh"),
        (bare, "a mesh without joint weights"),
        (bound(np.zeros((3, 1)), np.ones((3, 1))), "both \\(4, k\\) for 4 splats"),
        (bound(-np.ones((4, 1)), np.ones((4, 1))), "joint -1"),
    ):
        with pytest.raises(StageError, match=said):
            Skin(device, binding, points, SkinParameters())
    pose = SkinPose(joints=np.eye(4)[None])
    with pytest.raises(StageError, match="joint 1, expected 0 to 0"):
        moved(device, bound(np.ones((4, 1)), np.ones((4, 1))), pose, points)
    with pytest.raises(StageError, match="no mesh, or one with other points"):
        moved(device, bare, pose, points, binding="triangles")
