"""Each rule of the ablation changes the source as it is now."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rule_patches import RULES, Rule, write_variant

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_a_rule_can_be_left_out(rule: Rule) -> None:
    texts: dict[str, str] = {}
    for name, old, new in rule.changes:
        text = texts.get(name) or (ROOT / "src" / "cuboid" / name).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{name}: {old!r}"
        texts[name] = text.replace(old, new)
    for name, text in texts.items():
        words = (sys.executable, "-m", "ruff", "check", "--isolated", "--select", "F821", "--stdin-filename", name, "-")
        done = subprocess.run(words, input=text, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{name}: a name is not defined, or the text is no Python: {done.stdout}"


def test_a_rule_that_does_not_match_the_source_is_an_error(tmp_path: Path) -> None:
    source = tmp_path / "cuboid"
    source.mkdir()
    (source / "a.py").write_text("x = 1\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"gone: stands 0 times in a\.py"):
        write_variant(source, [Rule("gone", 1, (("a.py", "y = 1", ""),))], tmp_path / "variant")
