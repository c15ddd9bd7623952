"""Tests of projecting single splats. Oracles: closed forms, and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels import crop, project

FOCAL = 800.0


def camera(**changes):
    record = np.zeros(1, project.CAMERA)
    record["fx"] = record["fy"] = FOCAL
    record["near"], record["far"] = 0.01, 1e10
    record["low_u"], record["high_u"], record["low_v"], record["high_v"] = -2, 2, -2, 2
    record["left"], record["top"], record["right"], record["bottom"] = -1e6, -1e6, 1e6, 1e6
    record["low_pass"], record["trained"] = project.LOW_PASS, np.inf
    for name, value in changes.items():
        record[name] = value
    return record


def project_rows(
    device, positions, *, scales, rotations=None, opacities=None, matrix=None, weights=(), **changes
):
    """Records, keys and sources of the visible splats of one field, in block order."""
    positions = np.float32(positions)
    n = len(positions)
    rotations = np.tile(np.float32([1, 0, 0, 0]), (n, 1)) if rotations is None else rotations
    opacities = np.ones(n, np.float32) if opacities is None else np.float32(opacities)
    matrix = np.eye(4) if matrix is None else matrix
    block = min(n, project.BLOCK)
    blocks = -(-n // block)
    out = (
        np.zeros((blocks * block, project.RECORD), np.float32),
        np.zeros(blocks * block, np.float32),
        np.zeros(blocks * block, np.int32),
    )
    found = np.zeros(blocks, np.int32)
    volumes, crops = np.empty(0, crop.CROP), np.empty((1, 0, 3, 4))
    device.run(
        project.project, camera(**changes), matrix[None, :3].copy(), np.float32(weights),
        volumes, crops, np.empty(0, np.int32), device.upload(positions),
        device.upload(np.float32(rotations)), device.upload(np.float32(scales)),
        device.upload(opacities), np.empty(0, np.uint8), block, 0, out, found,
    )  # fmt: skip
    rows = np.concatenate([np.arange(found[b]) + b * block for b in range(blocks)])
    return tuple(array[rows] for array in out)


def covariance(record):
    """Screen covariance of a record, from the exponent it stores."""
    a, b, c = record[[project.A, project.B, project.C]].astype(np.float64)
    return np.linalg.inv(-2.0 * np.array([[a, b / 2], [b / 2, c]]))


@pytest.mark.parametrize("depth", [1.0, 10.0, 1000.0])
def test_round_splat_on_the_axis_is_a_disc_of_similar_triangles(device, depth):
    """Oracle: sigma_pixel = f sigma / depth, because the map is a pure scaling there."""
    sigma = 0.05
    (record,), _, _ = project_rows(device, [[0, 0, depth]], scales=[[sigma] * 3])
    expected = ((FOCAL * sigma / depth) ** 2 + 0.3) * np.eye(2)
    assert record[project.U] == record[project.V] == 0
    assert record[project.DEPTH] == np.float32(depth)
    np.testing.assert_allclose(covariance(record), expected, rtol=2e-6, atol=1e-9)


def test_covariance_is_the_jacobian_sandwich(device):
    """Oracle: central differences of the pinhole map in float64, nothing of ours."""
    rng = np.random.default_rng(3)
    mean = np.array([0.4, -0.3, 2.0])
    scales = np.array([0.02, 0.05, 0.1])
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    w, x, y, z = q
    turn = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )
    shear = np.array([[1.0, 0.3, 0.0], [0.0, -0.8, 0.1], [0.2, 0.0, 1.1]])
    matrix = np.eye(4)
    matrix[:3, :3] = shear
    world = shear @ turn @ np.diag(scales**2) @ turn.T @ shear.T

    def pinhole(p):
        return FOCAL * p[:2] / p[2]

    center = shear @ mean
    h = 1e-5
    jacobian = np.stack(
        [(pinhole(center + s) - pinhole(center - s)) / (2 * h) for s in h * np.eye(3)], axis=1
    )
    expected = jacobian @ world @ jacobian.T + 0.3 * np.eye(2)
    (record,), _, _ = project_rows(device, [mean], scales=[scales], rotations=[q], matrix=matrix)
    np.testing.assert_allclose(covariance(record), expected, rtol=2e-5)
    np.testing.assert_allclose(record[:2], pinhole(center), rtol=1e-6)


def test_a_tangential_splat_off_the_axis_keeps_its_shape(device):
    """Oracle: a round splat seen along its own ray is round, with sigma f sigma / distance."""
    p = np.array([1.5, 0.7, 1.0])
    (record,), _, _ = project_rows(device, [p], scales=[[0.05] * 3], projection=project.TANGENTIAL)
    expected = ((FOCAL * 0.05 / np.linalg.norm(p)) ** 2 + 0.3) * np.eye(2)
    np.testing.assert_allclose(covariance(record), expected, rtol=1e-5, atol=1e-3)


def test_an_orthographic_splat_ignores_depth(device):
    """Oracle: a parallel projection multiplies by pixels per unit, whatever the depth."""
    records, _, _ = project_rows(
        device, [[0.5, 0.25, 1], [0.5, 0.25, 90]], scales=[[0.05] * 3] * 2,
        projection=project.ORTHOGRAPHIC,
    )  # fmt: skip
    np.testing.assert_allclose(records[:, :2], [[400, 200]] * 2, rtol=1e-6)
    np.testing.assert_array_equal(records[0, 2:8], records[1, 2:8])


def test_antialiasing_keeps_the_integral_of_a_small_splat(device):
    """Oracle: Yu et al. 2024: opacity times sqrt(det before / det after the low-pass)."""
    sigma = np.array([0.0005, 0.001])
    (record,), _, _ = project_rows(
        device, [[0, 0, 1]], scales=[[*sigma, 0.1]], opacities=[0.9], trained=0
    )
    before = (FOCAL * sigma) ** 2
    expected = 0.9 * np.sqrt(np.prod(before) / np.prod(before + 0.3))
    np.testing.assert_allclose(np.exp(record[project.LOG_OPACITY]), expected, rtol=1e-5)


def test_the_low_pass_of_the_photographs_keeps_its_size_at_the_splat(device):
    """Oracle: a low-pass of 0.3 pixel² of pixels of a size at the splat is 0.3 (size f / z)² of the
    picture's pixels, enlarged by an instance; up to the picture's own the opacity is kept."""
    sigma, size, scale = 0.0005, 0.01, 1.5
    depths = np.array([2.0, 40.0, 80.0, 1e5])
    records, _, _ = project_rows(
        device, [[0, 0, depth / scale] for depth in depths], scales=[[sigma] * 3] * 4,
        opacities=[0.9] * 4, matrix=np.diag([scale] * 3 + [1.0]),
        trained=0.3 * size**2 * FOCAL**2,
    )  # fmt: skip
    variance = (FOCAL * scale * sigma / depths) ** 2
    trained = np.minimum(0.3, 0.3 * (FOCAL * scale * size / depths) ** 2)
    expected = 0.9 * (variance + trained) / (variance + 0.3)
    assert expected[0] == 0.9
    assert expected[3] < 1 / 255, "the last one is too faint to be seen"
    np.testing.assert_allclose(np.exp(records[:, project.LOG_OPACITY]), expected[:3], rtol=1e-5)


def test_the_determinant_of_a_needle_does_not_cancel(device):
    """Oracle: float64 linear algebra; a needle at 45 degrees with axes 1 : 1e5."""
    turn = [np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)]
    (record,), _, _ = project_rows(
        device, [[0, 0, 1]], scales=[[10.0, 1e-4, 1e-4]], rotations=[turn]
    )
    r = np.array([[1, -1], [1, 1]]) / np.sqrt(2)
    expected = r @ np.diag([(FOCAL * 10) ** 2, (FOCAL * 1e-4) ** 2]) @ r.T + 0.3 * np.eye(2)
    a, b, c = record[[project.A, project.B, project.C]].astype(np.float64)
    np.testing.assert_allclose(
        [a, b / 2, c], -0.5 * np.linalg.inv(expected)[[0, 0, 1], [0, 1, 1]], rtol=1e-4
    )


def test_a_capture_far_from_the_origin_loses_nothing(device):
    """Oracle: exact translation in float64: only what is relative to the camera matters."""
    rng = np.random.default_rng(0)
    near = rng.uniform(-1, 1, (100, 3)) + np.array([0, 0, 5])
    base = np.float32(4096.0)
    stored = np.float32(near + base)  # what float32 kept of the far capture
    matrix = np.eye(4)
    matrix[:3, 3] = -base
    far, _, _ = project_rows(device, stored, scales=np.full((100, 3), 0.05), matrix=matrix)
    exact = stored.astype(np.float64) - base
    np.testing.assert_allclose(
        far[:, :2], FOCAL * exact[:, :2] / exact[:, 2:], rtol=3e-7, atol=1e-4
    )


def test_what_cannot_be_seen_is_left_out(device):
    """Oracle: the rules of culling: clipping range by centre, cutoff, window, and no NaN."""
    nan, inf = np.nan, np.inf
    positions = [
        [0, 0, 1], [0, 0, -1], [0, 0, 0.005], [0, 0, 50],
        [0, 0, 1], [0, 0, nan], [inf, 0, 1], [50, 0, 1],
    ]  # fmt: skip
    opacities = [1, 1, 1, 1, 1 / 256, 1, 1, 1]
    _, keys, sources = project_rows(
        device, positions, scales=[[0.01] * 3] * 8, opacities=opacities, far=40.0,
        left=-500, right=500, top=-500, bottom=500,
    )  # fmt: skip
    assert sources.tolist() == [0]
    assert keys.tolist() == [1.0]


def test_the_footprint_is_where_the_contribution_falls_under_the_cutoff(device):
    """Oracle: closed form, 255 o exp(-d²/2) = 1 at the half width of a round splat."""
    (record,), _, _ = project_rows(device, [[0, 0, 1]], scales=[[0.01] * 3], opacities=[0.5])
    sigma2 = (FOCAL * 0.01) ** 2 + 0.3
    np.testing.assert_allclose(
        record[project.HALF_WIDTH], np.sqrt(2 * np.log(255 * 0.5) * sigma2), rtol=1e-6
    )
    assert record[project.HALF_WIDTH] == record[project.HALF_HEIGHT]


def test_distance_keys_do_not_change_when_the_camera_turns(device):
    """Oracle: geometry: distance from the eye is invariant under rotation, depth is not."""
    angle = 0.4
    c, s = np.cos(angle), np.sin(angle)
    yaw = np.eye(4)
    yaw[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    points = np.random.default_rng(1).uniform(-1, 1, (50, 3)) + np.array([0, 0, 6])
    options = {"scales": np.full((50, 3), 0.01), "sorting": project.SORT_DISTANCE}
    _, straight, _ = project_rows(device, points, **options)
    _, turned, _ = project_rows(device, points, matrix=yaw, **options)
    np.testing.assert_allclose(straight, turned, rtol=1e-6)
    np.testing.assert_allclose(straight, (np.float32(points) ** 2).sum(axis=1), rtol=1e-6)
