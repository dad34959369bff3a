"""The notebooks executed, and the texts beside them, as HTML pages that need neither Python nor a network.

    python -m course.pages DIR

Run it in the folder of the notebooks. nbconvert makes the pages; formulas are MathML here, in place of a script
from the network, and panels the picture and the words that they show.
"""

from __future__ import annotations

import html
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from latex2mathml.converter import convert
from nbclient import NotebookClient
from nbconvert import HTMLExporter
from pygments.formatters import HtmlFormatter  # type: ignore[import-untyped]

from vo_lib.commands.script import ENDINGS, OneLineParser, exit_code
from vo_lib.errors import DataError
from vo_lib.files import write_atomic

NOTEBOOKS = Path(__file__).resolve().parents[1]
WIDGETS = "application/vnd.jupyter.widget-state+json"
VIEW = "application/vnd.jupyter.widget-view+json"
CELL_TIMEOUT_S = 1200
REFERENCE = "IPY_MODEL_"
PARTS = ("HTMLModel", "ImageModel", "VBoxModel", "HBoxModel")  # of a panel, that a page can show
FORMULA = re.compile(r"(```.*?```|`[^`\n]*`)|\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{style}
body {{ max-width: 1010px; margin: 24px auto; padding: 0 12px; font: 15px/1.5 sans-serif; color: #222 }}
pre {{ font: 13px/1.35 monospace; overflow-x: auto }} img {{ max-width: 100% }}
.jp-InputArea, .highlight {{ background: #f6f6f6; padding: 2px 10px }} .prompt {{ display: none }}
td, th {{ padding: 2px 10px; border-bottom: 1px solid #ddd; text-align: left }}
/* Without a font for formulas Chromium draws subscripts on the line. */
math {{ font-family: "Cambria Math", "STIX Two Math", "Latin Modern Math", "DejaVu Math TeX Gyre", math }}
math[display="block"] {{ margin: 12px 0 }} .panel {{ border: 1px solid #bbb; padding: 8px }}
</style></head><body>{body}</body></html>
"""


def write_pages(source: Path, target: Path) -> int:
    """Write a page into `target` for every notebook and text in `source`; the number of cells that failed.

    Raises `DataError` where a notebook is damaged.
    """
    failed = 0
    for path in sorted([*source.glob("*.ipynb"), *source.glob("solutions/*.ipynb"), *source.glob("*.md")]):
        name, notebook = path.relative_to(source), read(path)
        print(f"{name} …")
        if path.suffix == ".ipynb":
            execute(notebook, source)
        for number, cell in enumerate(notebook.cells):
            if any(output.output_type == "error" for output in cell.get("outputs", [])):
                print(f"{name}: cell {number} failed")
                failed += 1
        place = (target / name).with_suffix(".html")
        place.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(place, page(notebook, path))
    for path in source.glob("*.csv"):  # tables to which the pages link
        write_atomic(target / path.name, path.read_bytes())
    print(f"open {target / '00_start_here.html'}")
    return failed


def read(path: Path) -> Any:
    """A notebook, or a text as one; `DataError` where the file is damaged."""
    if path.suffix == ".md":
        text = nbformat.v4.new_markdown_cell(path.read_text(encoding="utf-8"))  # type: ignore[no-untyped-call]
        return nbformat.v4.new_notebook(cells=[text])  # type: ignore[no-untyped-call]
    try:
        return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    except Exception as error:  # of JSON, of its schema, of versions: they share no other base
        raise DataError(f"is no notebook: {str(error).splitlines()[0][:100]}", path) from None


def execute(notebook: Any, beside: Path) -> None:
    """Give a notebook its outputs and errors; it runs in an empty folder and imports the course `beside` it."""
    with tempfile.TemporaryDirectory() as folder:
        where = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, timeout=CELL_TIMEOUT_S, allow_errors=True, resources=where)
        paths = [str(beside), os.environ.get("PYTHONPATH", "")]
        client.execute(env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))})


def page(notebook: Any, path: Path) -> str:
    """An executed notebook as a page, pictures inside; folders of this machine are written as `.` and `~`."""
    state = notebook.metadata.pop("widgets", {}).get(WIDGETS, {}).get("state", {})
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = with_mathml(
                re.sub(r"\]\((?!\w+://)([^)#\s]+)\.(?:ipynb|md)", r"](\1.html", cell.source)
            )
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if VIEW in data:
                shown = "".join(_shown(state, data[VIEW]["model_id"]))
                output["data"] = {"text/html": f'<div class="panel">{shown}</div>' if shown else ""}
    exporter = HTMLExporter(template_name="basic", embed_images=True, exclude_anchor_links=True)  # type: ignore[no-untyped-call]
    body, _ = exporter.from_notebook_node(notebook, {"metadata": {"path": str(path.parent)}})
    for folder, short in ((NOTEBOOKS.parent, "."), (Path.home(), "~")):
        body = body.replace(f"{html.escape(str(folder))}/", f"{short}/")
    style = HtmlFormatter().get_style_defs(".highlight")
    return PAGE.format(title=html.escape(path.stem), style=style, body=body)


def with_mathml(markdown: str) -> str:
    """Markdown whose formulas, between $ or $$, are MathML, which needs no script; code stays as it is."""

    def drawn(found: re.Match[str]) -> str:
        code, display, inline = found.groups()
        if code:
            return str(code)
        try:
            made = convert(display or inline, display="block" if display else "inline")
        except Exception:  # a reader's own formula with a slip, as it was typed; they share no other base
            return found.group()
        # Bars that stand alone would grow with what follows; as a character they would end a table's cell.
        made = re.sub(r"<mo>(&#x0(?:007C|2016);)</mo>", r'<mo stretchy="false">\1</mo>', made)
        return str(made).replace("|", "&#124;")

    return FORMULA.sub(drawn, markdown)


def _shown(state: dict[str, Any], model: str) -> list[str]:
    """Pictures and words of a widget and of all that it holds but controls, as HTML."""
    widget = state.get(model, {"state": {}})
    values, name = widget["state"], widget.get("model_name")
    if name == "ImageModel":
        data = next(each["data"] for each in widget["buffers"] if each["path"] == ["value"])
        return [f'<img alt="the panel" src="data:image/{values["format"]};base64,{data}">']
    if name == "HTMLModel":
        return [str(values.get("value", ""))]
    children = [child.removeprefix(REFERENCE) for child in values.get("children", [])]
    if children and state.get(children[0], {}).get("model_name") not in PARTS:
        return []  # a control and its caption, which says nothing without it
    return [part for child in children for part in _shown(state, child)]


def main() -> int:
    """Write the pages; 1 where a cell failed, 2 where a file could not be read or written."""
    parser = OneLineParser(prog="python -m course.pages", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder for the pages")
    options = parser.parse_args()
    try:
        return min(write_pages(NOTEBOOKS, options.folder), 1)
    except ENDINGS as error:
        return exit_code(parser.prog, error)


if __name__ == "__main__":
    sys.exit(main())
