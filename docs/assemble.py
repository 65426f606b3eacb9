"""Put the site's pages together from what is in the repository; nothing is executed.

python docs/assemble.py results/site/source
"""

import ast
import hashlib
import html
import io
import json
import re
import shutil
import sys
from base64 import b64decode
from importlib.util import find_spec
from pathlib import Path

from PIL import Image
from reference import write_reference

from profilecal_pages import items

ROOT = Path(__file__).parents[1]
COPIED = (
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "CITATION.cff",
    "LICENSE",
    "data/README.md",
    "data/examples/edge.toml",
    "data/examples/planned.toml",
    "data/examples/scan.toml",
    "docs/answer.png",
    "docs/errata.md",
    "docs/tiles.png",
    "tests/library/targets/test_new_target.py",
)
THUMBNAIL = 420  # pixels wide
ENVIRONMENT = hashlib.sha256((ROOT / "environment.txt").read_bytes()).hexdigest()[:12]
# of `make reproduce`, which know how long they took
RUNS = ROOT / "results" / "notebooks"


def assemble(source: Path) -> None:
    """Everything that Sphinx reads, under `source`, which is emptied first."""
    shutil.rmtree(source, ignore_errors=True)
    static = source / "_static"
    (static / "gallery").mkdir(parents=True)
    for name in filter(lambda name: (ROOT / name).exists(), COPIED):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    shutil.copy(ROOT / "docs" / "conf.py", source)
    shutil.copy(ROOT / "docs" / "style.css", static)
    mathjax = shutil.copytree(
        Path(find_spec("jupyter_server_mathjax").origin).parent / "static",
        static / "MathJax",
    )
    script = mathjax / "config" / "TeX-AMS-MML_HTMLorMML-full.js"
    loadable = script.read_text(encoding="utf-8").replace(
        "url('about:blank')", "local('none')"
    )  # browsers refuse it
    script.write_text(loadable, encoding="utf-8")

    notebooks = sorted((ROOT / "notebooks").glob("*.ipynb"))
    write_reference(source / "reference", notebooks)
    python = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    (source / "docs" / "python.md").write_text(linked(python), encoding="utf-8")
    (source / "notebooks").mkdir()
    figures = [
        figure
        for path in notebooks
        for figure in page_of(path, source / "notebooks", static / "gallery")
    ]
    (source / "gallery.md").write_text(gallery(figures), encoding="utf-8")
    for name, page in (("answer", "00_start_here"), ("tiles", "01_side_by_side")):
        picture = first_picture(ROOT / "notebooks" / f"{page}.ipynb")
        (static / f"{name}.png").write_bytes(picture)
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    index = index.replace("SENTENCE", items.sentence(items.gather(ROOT / "notebooks")))
    (source / "index.md").write_text(index, encoding="utf-8")


def linked(text: str) -> str:
    """A page in which `pc.name` in the text is a link to the reference, and examples
    end without the empty line that doctest needs.
    """
    text = text.replace("\n\n```\n", "\n```\n")
    return re.sub(r"`(pc\.([\w.]+))`", r"{py:obj}`\1 <profilecal.\2>`", text)


def first_picture(path: Path) -> bytes:
    """The first figure of a notebook, PNG."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    data = [
        output.get("data", {}) for cell in cells for output in cell.get("outputs", [])
    ]
    return b64decode(next(entry["image/png"] for entry in data if "image/png" in entry))


def page_of(path: Path, folder: Path, gallery: Path) -> list[dict]:
    """Write a notebook with places to link to and a last word on how it was run.
    Returns its figures.
    """
    notebook = json.loads(path.read_text(encoding="utf-8"))
    title = next(
        line
        for line in text_of(notebook["cells"][0]).splitlines()
        if line.startswith("# ")
    )[2:]
    cells, figures = [], []
    for cell in notebook["cells"]:
        data = [output.get("data", {}) for output in cell.get("outputs", [])]
        names = (
            re.findall(r"results\.figure\(\w+, f?\"([^\"]+)\"", text_of(cell))
            if cell["cell_type"] == "code"
            else []
        )
        pictures = [entry["image/png"] for entry in data if "image/png" in entry]
        anchors = [f"figure-{k}" for k, _ in enumerate(pictures, len(figures) + 1)]
        if anchors:
            cells.append(
                markdown("".join(f'<a id="{anchor}"></a>' for anchor in anchors))
            )
        for k, (anchor, picture) in enumerate(zip(anchors, pictures, strict=False)):
            thumbnail = f"{path.stem}_{anchor}.png"
            shrink(b64decode("".join(picture)), gallery / thumbnail)
            name = names[k] if k < len(names) and "{" not in names[k] else anchor
            figures.append(
                {
                    "notebook": path.stem,
                    "title": title,
                    "anchor": anchor,
                    "name": name,
                    "image": thumbnail,
                }
            )
        cells.append(cell)
    cells.append(markdown(how_it_was_run(path, notebook)))
    notebook["cells"] = cells
    (folder / path.name).write_text(json.dumps(notebook), encoding="utf-8")
    used = parameters(notebook)
    return [figure | {"parameters": used} for figure in figures]


def text_of(cell: dict) -> str:
    return "".join(cell["source"])


def markdown(text: str) -> dict:
    return {
        "cell_type": "markdown",
        "id": hashlib.sha256(text.encode()).hexdigest()[:8],
        "metadata": {},
        "source": text,
    }


def shrink(png: bytes, path: Path) -> None:
    """Write a picture as a thumbnail."""
    with Image.open(io.BytesIO(png)) as image:
        image = image.convert("RGB")
        image.thumbnail((THUMBNAIL, 4 * THUMBNAIL))
        image.save(path, optimize=True)


def parameters(notebook: dict) -> str:
    """A notebook's parameters in a line."""
    (cell,) = [
        c for c in notebook["cells"] if "parameters" in c["metadata"].get("tags", [])
    ]
    pairs = [
        (node.target.id, ast.literal_eval(node.value))
        for node in ast.parse(text_of(cell)).body
    ]
    return ", ".join(
        f"{name} = {value}" for name, value in pairs if not name.endswith("_dir")
    )


def how_it_was_run(path: Path, notebook: dict) -> str:
    """The last cell of a notebook's page."""
    took = ""
    if (RUNS / path.name).exists():
        metadata = json.loads((RUNS / path.name).read_text(encoding="utf-8"))[
            "metadata"
        ].get("papermill", {})
        took = (
            f" It took {metadata['duration']:.0f} s in the last `make reproduce`."
            if metadata.get("duration")
            else ""
        )
    given = parameters(notebook)
    return (
        f"## This page\n\n`notebooks/{path.name}` as executed"
        f"{' with ' * bool(given)}{given}; environment "
        f"`{ENVIRONMENT}` (SHA-256 of `environment.txt`).{took}"
    )


def gallery(figures: list[dict]) -> str:
    """All figures, small, each a link to the cell that draws it."""
    parts = ["# Gallery\n\nEvery figure is a link to the cell that draws it.\n"]
    for title in dict.fromkeys(figure["title"] for figure in figures):
        parts.append(f"## {title}\n\n<div class='gallery'>")
        for figure in (f for f in figures if f["title"] == title):
            about = html.escape(
                f"{figure['notebook']}, {figure['name']}: {figure['parameters']}; "
                f"environment {ENVIRONMENT}"
            )
            page = f"notebooks/{figure['notebook']}.html#{figure['anchor']}"
            picture = f"_static/gallery/{figure['image']}"
            parts.append(
                f"<a href='{page}' title='{about}'>"
                f"<img loading='lazy' alt='{about}' src='{picture}'>"
                f"<span>{html.escape(figure['name'].replace('_', ' '))}</span></a>"
            )
        parts.append("</div>\n")
    return "\n".join(parts)


if __name__ == "__main__":
    assemble(Path(sys.argv[1]))
