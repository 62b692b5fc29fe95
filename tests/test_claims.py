"""Every number of README and documentation has a source that gives it."""

import shutil

import claims
import provenance
import pytest

PAGES = claims.pages()


def name_of(page):
    return page.relative_to(claims.ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_no_number_comes_from_nowhere(page):
    assert claims.sourceless(page) == []


def test_every_claim_is_what_its_source_gives():
    found = list(claims.claims_of())
    assert len(found) > 150
    assert [claim for claim in found if not claim.holds] == []
    for written, value, relation in [("0.77", 0.7649, "p"), ("2,000", 2001, "p"), ("3", 3.1, "<")]:
        assert not claims.agrees(written, value, relation, 0.0)


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("it took 12 s, and lost 17.3 % of 1,925 samples", ["12", "17.3", "1,925"]),
        ("it is named in 3 of 4 and keeps 1e-12", ["3", "1e-12"]),
        ("by (15) and eq. (2), 2 μ²σ² with `levels=250` in Fig. 8 [1], since 2003", []),
        ("```text\n12 s\n```\n[more](page.md#99-s) in \\(a + 1.5\\)", []),
    ],
)
def test_what_a_claim_is(text, numbers):
    prose = claims.blank(text)
    found = [each for each in claims.NUMBER.finditer(prose) if claims.is_claim(each, prose)]
    assert [each.group() for each in found] == numbers


def test_a_sentence_without_its_result_is_left_out(tmp_path):
    page = "docs/method/paper.md"
    text = (claims.ROOT / page).read_text(encoding="utf-8")
    assert claims.without_missing(page, text) == text
    for path in provenance.RESULTS.glob("*.json"):
        if path.stem != "paper":
            shutil.copy(path, tmp_path)
    left = claims.without_missing(page, text, tmp_path)
    assert "0.99997" in text
    assert "0.99997" not in left
    assert "which the authors leave to future work" in left
    assert "| (3), (4) |" in left


def test_a_result_of_another_version_is_told(tmp_path, monkeypatch):
    head = provenance.git("rev-parse", "HEAD")
    if head is None:
        pytest.skip("not in a clone")
    monkeypatch.setattr(provenance, "RESULTS", tmp_path)
    old = provenance.git("rev-list", "--max-parents=0", "HEAD") or ""
    clean = provenance.git("status", "--porcelain", "--", "preisach_jax") == ""
    (tmp_path / "new.json").write_text(f'{{"commit": "{head}"}}')
    (tmp_path / "old.json").write_text(f'{{"commit": "{old.split()[0]}"}}')
    (tmp_path / "none.json").write_text("{}")
    found = provenance.outdated() or {}
    assert {"old.json", "none.json"} <= set(found)
    assert ("new.json" in found) is not clean
