"""`python -m usdsplat` is the `usdsplat` command."""

from __future__ import annotations

from usdsplat.cli.main import main

raise SystemExit(main())
