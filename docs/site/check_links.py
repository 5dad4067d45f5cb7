"""Check the links of the built site: ``python docs/site/check_links.py docs/_build/html``.

Each link within the site must lead to a file and an anchor that are there. Addresses of other sites are only listed, in
``external-links.txt`` beside the site: a build needs no network.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The links and the anchors of one page, and the files that it loads from elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep the addresses and the id of a tag."""
        values = {name: value for name, value in attrs if value is not None}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        self.links += [values[name] for name in ("href", "src") if name in values]
        if tag in {"script", "img", "link", "iframe"} and values.get("rel") not in {"canonical", "next", "prev"}:
            self.loads += [values[name] for name in ("href", "src") if name in values]


def read_site(folder: Path) -> dict[Path, Page]:
    """Return the pages of a site by their resolved paths."""
    files = (file for file in folder.rglob("*.html") if "_static" not in file.relative_to(folder).parts)
    return {file.resolve(): Page(file.read_text(encoding="utf-8")) for file in files}


def broken_links(site: dict[Path, Page]) -> list[str]:
    """Return "page: link" of each link within the site that leads nowhere, and of each file loaded from elsewhere."""
    broken = []
    for file, page in site.items():
        broken += [f"{file.name}: loads {link}" for link in page.loads if urlsplit(link).netloc]
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchor = unquote(parts.fragment)
            known = site[target].anchors if target in site else None
            if not target.exists() or (anchor and known is not None and anchor not in known):
                broken.append(f"{file.name}: {link}")
    return sorted(set(broken))


def external_links(site: dict[Path, Page]) -> list[str]:
    """Return the addresses of other sites, sorted."""
    return sorted({link for page in site.values() for link in page.links if urlsplit(link).scheme in {"http", "https"}})


def main(folder: Path) -> int:
    """Print what was found; return 1 if a link is broken."""
    site = read_site(folder)
    broken, external = broken_links(site), external_links(site)
    (folder.parent / "external-links.txt").write_text("".join(f"{link}\n" for link in external), encoding="utf-8")
    links = sum(len(page.links) for page in site.values())
    print("".join(f"broken: {line}\n" for line in broken), end="")
    print(
        f"{len(site)} pages, {links} links, {len(broken)} broken; {len(external)} addresses of other sites not checked"
    )
    return 1 if broken or not site else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
