"""Tests that docs/reference/schema.md is generated from the current schemas."""

from __future__ import annotations

from pxr import Usd

from usdsplat.schema import schema_page
from usdsplat.schema.generate import SOURCES


def test_the_committed_page_is_up_to_date() -> None:
    """Oracle: the generator, run again."""
    assert schema_page.TARGET.read_text(encoding="utf-8") == schema_page.page()


def test_every_type_and_property_that_usd_knows_is_on_the_page() -> None:
    """Oracle: USD's own registry, which reads plugInfo/."""
    text = schema_page.page()
    registry = Usd.SchemaRegistry()
    own = registry.FindConcretePrimDefinition("ParticleFieldSplatTree")
    stock = registry.FindConcretePrimDefinition("ParticleField")
    for name in set(own.GetPropertyNames()) - set(stock.GetPropertyNames()):
        assert f"| `{name}` |" in text, name
    mask = registry.FindAppliedAPIPrimDefinition("SplatSimMaskAPI")
    for name in mask.GetPropertyNames():
        assert f"| `{name.replace('__INSTANCE_NAME__', 'NAME')}` |" in text, name
    classes = sum(path.read_text().count("\nclass ") for path in SOURCES)
    assert text.count("\n## ") == classes


def test_check_says_whether_a_page_is_stale(tmp_path, monkeypatch) -> None:
    """Oracle: a page with other text, then the written one."""
    target = tmp_path / "schema.md"
    monkeypatch.setattr(schema_page, "TARGET", target)
    target.write_text("# Schema\n", encoding="utf-8")
    assert schema_page.main(["--check"]) == 1
    assert schema_page.main([]) == 0
    assert schema_page.main(["--check"]) == 0
