"""The site that `make site` built: every link leads somewhere, nothing comes from
elsewhere, a browser complains of nothing, the reference has all public names. Skipped
where there is no site, or no browser.
"""

import functools
import http.server
import re
import shutil
import subprocess
import threading
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest

import profilecal

SITE = Path(__file__).parents[2] / "results" / "site" / "html"
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
    None,
)
PAGES = sorted(
    path.relative_to(SITE).as_posix()
    for path in SITE.rglob("*.html")
    if "_static" not in path.parts
)
if not PAGES:
    pytest.skip("there is no site: make site", allow_module_level=True)


class Page(HTMLParser):
    """A page's places, links, and what it loads."""

    def __init__(self, name):
        super().__init__()
        self.ids, self.links, self.loads = set(), [], []
        self.feed((SITE / name).read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.ids.add(found.get("id"))
        if tag == "a" and found.get("href"):
            self.links.append(found["href"])
        if tag in ("script", "img", "iframe", "source") and found.get("src"):
            self.loads.append(found["src"])
        if tag == "link" and found.get("rel") in ("stylesheet", "icon", "preload"):
            self.loads.append(found["href"])


@functools.cache
def page(name):
    return Page(name)


@pytest.mark.parametrize("name", PAGES)
def test_every_link_leads_somewhere_and_nothing_comes_from_elsewhere(name):
    here = SITE / name
    for address in page(name).loads:
        assert not urlparse(address).netloc, f"{name} loads {address}"
    for address in page(name).links + page(name).loads:
        parts = urlparse(address)
        if parts.scheme:
            continue
        place = unquote(parts.path) or here.name
        target = (here.parent / place).resolve()
        assert target.exists(), f"{name} links to {address}"
        if parts.fragment and target.suffix == ".html":
            ids = page(target.relative_to(SITE).as_posix()).ids
            assert unquote(parts.fragment) in ids, f"{name}: {address}"


@pytest.mark.parametrize("name", profilecal.__all__)
def test_a_public_name_has_its_place_in_the_reference(name):
    assert f"profilecal.{name}" in page(f"reference/{name}.html").ids
    links = page("reference/profilecal.html").links
    assert f"{name}.html" in {link.split("#")[0] for link in links}


@pytest.fixture(scope="module")
def server():
    """The site at an address; what was asked for and not there."""
    missed = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_request(self, code, *_):
            if code >= 400:
                missed.append(self.path)

    with http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Handler, directory=SITE)
    ) as running:
        threading.Thread(target=running.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{running.server_port}", missed
        running.shutdown()


@pytest.mark.skipif(not BROWSER, reason="there is no Chromium here")
@pytest.mark.parametrize(
    "name",
    [
        "index.html",
        "notebooks/01_side_by_side.html",
        "gallery.html",
        "notebooks/10_edge_derivation.html",
        "docs/python.html",
        "reference/Scan.html",
    ],
)
def test_a_browser_complains_of_nothing(name, server, tmp_path):
    """No request elsewhere (no name but this machine's resolves), none that fails, no
    error in the console.
    """
    address, missed = server
    options = [
        *("--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"),
        *("--enable-logging=stderr", "--virtual-time-budget=20000"),
        "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
        f"--user-data-dir={tmp_path}",
    ]
    command = [BROWSER, *options, f"{address}/{name}"]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=True
    )
    complaints = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not complaints
    assert not [path for path in missed if path != "/favicon.ico"]
    if "derivation" in name:
        assert len(re.findall(r'class="MathJax(_SVG|_CHTML)?"', done.stdout)) > 20
        assert "data-mml-error" not in done.stdout
