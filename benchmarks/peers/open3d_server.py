"""Server in Open3D's interpreter: draws splats with Vulkan, until input ends.

    {"do": "open", "ply": PATH, "view": 4x4, "k": 3x3, "size": [w, h]} -> {"version": "0.20.0"}
    {"do": "draw"}               -> {"ms": 2749.0}, the picture in memory
    {"do": "save", "path": PATH} -> {}, the last picture as NumPy codes, (h, w, 3) uint8

`view` is the matrix from the world to an OpenCV camera, `k` its intrinsics [pixel].
"""

import json
import sys
import time

import numpy as np
import open3d
from open3d.visualization import rendering


class Picture:
    """A scene and its only camera."""

    def __init__(self, ply, view, k, size):
        material = rendering.MaterialRecord()
        material.shader = "gaussianSplat"
        self._renderer = rendering.OffscreenRenderer(*size)
        self._renderer.scene.set_background([0, 0, 0, 1])
        self._renderer.scene.view.set_post_processing(False)
        self._renderer.scene.add_geometry("splats", open3d.t.io.read_point_cloud(ply), material)
        self._renderer.setup_camera(np.array(k), np.array(view), *size)
        self.codes = None

    def draw(self):
        """Draw the picture. Return wall milliseconds."""
        start = time.perf_counter()
        self.codes = np.asarray(self._renderer.render_to_image())
        return 1e3 * (time.perf_counter() - start)


picture = None
for line in sys.stdin:
    request = json.loads(line)
    try:
        what = request.pop("do")
        answer = {}
        if what == "open":
            picture = Picture(**request)
            answer = {"version": open3d.__version__}
        elif what == "draw":
            answer = {"ms": picture.draw()}
        else:
            np.save(request["path"], picture.codes[..., :3])
    except Exception as error:
        answer = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps(answer), flush=True)
