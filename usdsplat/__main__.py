"""`python -m usdsplat` is the `usdsplat` command."""

from __future__ import annotations

from usdsplat.cli.supervise import entry

if __name__ == "__main__":  # workers of Dask import this module
    raise SystemExit(entry())
