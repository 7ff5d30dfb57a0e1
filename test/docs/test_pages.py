"""The pages name what is there, and the one that tells how it works takes ten minutes."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how_it_works.md"
TEXT = PAGE.read_text(encoding="utf-8")
FILES = re.findall(r"`((?:\w+/)+(?:\w+\.py)?)`", TEXT)


def test_it_takes_ten_minutes() -> None:
    # At 200 words a minute, equations and all.
    assert len(TEXT.split()) < 2000


def test_the_readme_leads_to_it() -> None:
    assert "docs/how_it_works.md" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("file", FILES)
def test_the_files_it_names_are_there(file: str) -> None:
    assert (ROOT / "src" / "usmap_ros" / file).exists()


PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_every_page_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#[^)]*)?\)", text):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_sources_that_pages_name_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for path in re.findall(r"`((?:src|test|benchmarks|tools|config|bags)/[\w./]+)`", text):
        assert (ROOT / path).exists(), path


def test_what_benchmarks_wrote_says_of_which_commit_it_is() -> None:
    for page in PAGES:
        for text in re.findall(
            r"<!-- (?:scores|ablations|poses|reliability|times) -->\n(.*?)<!-- /",
            page.read_text("utf-8"),
            re.S,
        ):
            assert re.search(r"^Measured with commit \w{7,} of \d{4}-\d\d-\d\d\.$", text, re.M)
