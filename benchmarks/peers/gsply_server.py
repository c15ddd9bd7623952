"""Server in gsply's interpreter: reads one request per line, answers with seconds, until input
ends.

    {"do": "read", "path": "a.ply"}                   -> {"wall": 0.3, "cpu": 0.3, "splats": 1000}
    {"do": "read", "path": "a.ply", "physical": true}
    {"do": "write", "path": "b.spz", "version": 4}    -> {"wall": 2.6, "cpu": 2.6}

With `physical`, logarithms, logits and views of the file's rows are converted to what our reader
returns: scales, opacities, and contiguous harmonics with degree 0 first. `write` writes what was
read last, from plain arrays, as a program that creates splats would have them. `save` writes what
was read last as NumPy arrays to `path`, for comparison.
"""

import json
import sys
import time

import gsply
import numpy as np
from gsply.sog_reader import sogread

FIELDS = ("means", "scales", "quats", "opacities", "sh0", "shN")


def read(path):
    """Read one file of any kind that gsply supports."""
    if path.endswith(".sog"):
        return sogread(path)
    return gsply.read_spz(path) if path.endswith(".spz") else gsply.plyread(path)


def write(path, data, version):
    """Write plain arrays to one file."""
    if path.endswith(".spz"):
        gsply.write_spz(path, data, version=version)
    else:
        arrays = {name: getattr(data, name) for name in FIELDS[1:]}
        gsply.plywrite(path, data.means, **arrays, compressed=path.endswith(".compressed.ply"))


def plain(data):
    """Copy the splats to separate arrays.

    As read, they are views of the file's rows, which gsply could write back unchanged.
    """
    arrays = {name: np.array(getattr(data, name)) for name in FIELDS if hasattr(data, name)}
    return gsply.GSData(**arrays)


def physical(data):
    """Return scales, opacities and harmonics for a renderer, in separate arrays."""
    one = np.float32(1)
    opacities = one / (one + np.exp(-data.opacities))
    sh = np.empty((len(data), 1 + data.shN.shape[1], 3), np.float32)
    sh[:, 0], sh[:, 1:] = data.sh0, data.shN
    return np.array(data.means), np.array(data.quats), np.exp(data.scales), opacities, sh


def answer(request, state):
    """Execute the request of one line."""
    if request["do"] == "save":
        np.savez(request["path"], **{name: getattr(state["data"], name) for name in FIELDS})
        return {}
    wall, cpu = time.perf_counter(), time.process_time()
    if request["do"] == "read":
        data = read(request["path"])
        if request.get("physical"):
            physical(data)
    else:
        write(request["path"], state["data"], request.get("version", 3))
        data = state["data"]
    spent = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    if request["do"] == "read":
        state["data"] = plain(data)
    return {**spent, "splats": len(data)}


def main():
    """Answer all lines."""
    state = {}
    for line in sys.stdin:
        try:
            print(json.dumps(answer(json.loads(line), state)), flush=True)
        except Exception as error:
            print(json.dumps({"error": repr(error)}), flush=True)


if __name__ == "__main__":
    main()
