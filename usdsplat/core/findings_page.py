"""Write docs/reference/findings.md, the page of all findings, from `CODES`.

python -m usdsplat.core.findings_page [--check]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from usdsplat.core.findings import CODES
from usdsplat.core.generated_page import REFERENCE, keep_page

TARGET = REFERENCE / "findings.md"

_HEAD = """# Findings

What a stage asks for and does not get is a finding. `render`, `simulate`, `convert`, `view`,
`match`, `info` and `validate` report the same finding with the same code and the same words: once
on stderr (`validate`: on stdout), and in the list `findings` of `--json`. Findings that begin at
a later frame have its time code.

- An **error** changes the picture or prevents it. A **warning** is a setting without effect, or a
  problem in other applications. A **note** is for information.
- `--strict` makes a command exit with status 1, and write nothing, if there is an error or a
  warning. `validate` writes nothing in any case; without `--strict` it exits with status 1 only
  for errors. Splats that are found inside affectors at the end of a simulation are the only
  finding that comes after the result is written.
- `-q` prints only findings that are errors, `-v` adds the cure of each finding, and messages of
  USD and other libraries.
- What a command cannot go on from, such as the requested camera if it forms no image, is no
  finding there but the error that ends it: one sentence without a code on stderr, status 2, with or
  without `--strict` and `--json`. `validate` reports it as a finding.
- Surfaces are diffuse, so nearly every asset has a gloss that is not drawn: a roughness below 0.5,
  clearcoats and normal maps are one note for the whole stage.
- Codes of splat fields are also the names of the UsdValidation errors of our validators, in
  camelCase.

This page is generated from `usdsplat/core/finding_codes/` by `python -m
usdsplat.core.findings_page`.

| code | severity | meaning | cure |
|---|---|---|---|
"""


def page() -> str:
    """Return the text of the page."""
    rows = [
        f"| `{name}` | {code.severity} | {code.meaning}"
        f"{f'; {code.consequence}' if code.consequence else ''} | {code.cure} |"
        for name, code in CODES.items()
    ]
    return _HEAD + "\n".join(rows) + "\n"


def main(arguments: Sequence[str]) -> int:
    """Write the page, or with --check return 1 if the stored one differs."""
    return keep_page(TARGET, page(), arguments)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
