"""What the site takes from elsewhere in the repository: results, CONTRIBUTING.md, and the page of configs."""

import re
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))
from configs import page_of_configs

REPOSITORY = Path(__file__).parents[2]
RESULTS = {".png", ".gif", ".csv", ".md"}
"""Endings of what is shown or linked of results/; the tables of single runs are left out."""
RUNS = {"runs", "trials", "panda_experiment"}
UP = re.compile(r"\]\(\.\./(?=results/)")
"""A link from a page in docs/ to results/, as it works in a checkout."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what does not lie in docs/."""
    for path in sorted((REPOSITORY / "results").rglob("*")):
        inside = path.relative_to(REPOSITORY)
        if path.suffix in RESULTS and not RUNS & set(inside.parts):
            files.append(File.generated(config, inside.as_posix(), abs_src_path=str(path)))
    files.append(File.generated(config, "configs.md", content=page_of_configs(REPOSITORY)))
    files.append(File.generated(config, "contributing.md", abs_src_path=str(REPOSITORY / "CONTRIBUTING.md")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The links of a page in a checkout, as links of the site."""
    if page.file.src_uri == "contributing.md":
        return markdown.replace("](docs/", "](")
    return UP.sub("](", markdown)
