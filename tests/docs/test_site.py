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
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest
from bs4 import BeautifulSoup

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


@functools.cache
def page(name):
    """A page's places, links, and what it loads."""
    parsed = BeautifulSoup((SITE / name).read_text(encoding="utf-8"), "html.parser")
    ids = {tag["id"] for tag in parsed.find_all(id=True)}
    links = [tag["href"] for tag in parsed.find_all("a", href=True)]
    loading = parsed.find_all(["script", "img", "iframe", "source"], src=True)
    linked = parsed.find_all("link", rel=["stylesheet", "icon", "preload"])
    return ids, links, [tag.get("src") or tag["href"] for tag in loading + linked]


@pytest.mark.parametrize("name", PAGES)
def test_every_link_leads_somewhere_and_nothing_comes_from_elsewhere(name):
    here = SITE / name
    _, links, loads = page(name)
    for address in loads:
        assert not urlparse(address).netloc, f"{name} loads {address}"
    for address in links + loads:
        parts = urlparse(address)
        if parts.scheme:
            continue
        place = unquote(parts.path) or here.name
        target = (here.parent / place).resolve()
        assert target.exists(), f"{name} links to {address}"
        if parts.fragment and target.suffix == ".html":
            ids, *_ = page(target.relative_to(SITE).as_posix())
            assert unquote(parts.fragment) in ids, f"{name}: {address}"


@pytest.mark.parametrize("name", profilecal.__all__)
def test_a_public_name_has_its_place_in_the_reference(name):
    ids, *_ = page(f"reference/{name}.html")
    assert f"profilecal.{name}" in ids
    _, links, _ = page("reference/profilecal.html")
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
