"""Install the peers; see the package."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

from benchmarks.peers import FOLDER, NODE_PEERS, PYTHON_PEERS, missing, python_of


def main() -> None:
    """Install what is missing, and report what could not be installed."""
    for name, packages in PYTHON_PEERS.items():
        folder = FOLDER / name
        if python_of(name) is None:
            subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet"]
        subprocess.run([*pip, "--only-binary=:all:", *packages], check=False)
    if npm := shutil.which("npm"):
        folder = FOLDER / "node"
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / "package.json").exists():
            (folder / "package.json").write_text("{}")
        # node 22 first: splat-transform requires it, and its installer runs with the installed
        # version.
        bin_folder = folder / "node_modules" / "node" / "bin"
        path = f"{bin_folder}{os.pathsep}{os.environ.get('PATH', '')}"
        for package in NODE_PEERS:
            command = [npm, "install", "--no-fund", "--no-audit", package]
            subprocess.run(command, cwd=folder, env={**os.environ, "PATH": path}, check=False)
            subprocess.run([npm, "install-scripts", "approve", "node"], cwd=folder, check=False)
            subprocess.run([npm, "rebuild"], cwd=folder, check=False)
    for sentence in missing():
        print(sentence)


if __name__ == "__main__":
    main()
