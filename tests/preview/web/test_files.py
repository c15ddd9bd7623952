"""Tests of joining the page's scripts."""

from __future__ import annotations

import re

from usdsplat.preview.web.files import files, joined


def test_modules_are_joined_in_the_order_of_their_imports() -> None:
    """Oracle: written out by hand."""
    found = joined(
        {
            "main": 'import { Two } from "./two.js";\nimport { one } from "./one.js";\nrun(Two);',
            "one": "const hidden = 1;\nexport function one() {}",
            "two": 'import { one } from "./one.js";\nexport class Two {}\nexport const X = 2;',
        },
        "main",
    )
    assert found == (
        "const one_js = (() => {\nconst hidden = 1;\nfunction one() {}\nreturn { one };\n})();\n"
        "const two_js = (() => {\nconst { one } = one_js;\nclass Two {}\nconst X = 2;\n"
        "return { Two, X };\n})();\n"
        "const main_js = (() => {\nconst { Two } = two_js;\nconst { one } = one_js;\nrun(Two);\n"
        "return {  };\n})();\n"
    )


def test_nothing_of_a_module_is_left_over() -> None:
    """Oracle: a page that is one file has no import, and each of its modules once."""
    page = files()[""].body.decode()
    assert not re.search(r"^(import|export) ", page, re.MULTILINE)
    assert 'src="main.js"' not in page and 'href="style.css"' not in page
    names = re.findall(r"^const (\w+)_js = ", page, re.MULTILINE)
    assert len(names) == len(set(names)) >= 8 and names[-1] == "main"
