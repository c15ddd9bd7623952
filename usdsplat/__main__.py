"""`python -m usdsplat` is the `usdsplat` command."""

from __future__ import annotations

from usdsplat.cli.supervise import entry

raise SystemExit(entry())
