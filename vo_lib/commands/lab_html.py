"""`vo lab --html`: executed notebooks as pages that need neither Python nor a network, and their pictures."""

from __future__ import annotations

import html
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import nbclient
import nbformat
from latex2mathml.converter import convert
from nbconvert import HTMLExporter
from pygments.formatters import HtmlFormatter  # type: ignore[import-untyped]

from ..core.errors import DataError
from ..core.files import require_own, write_result
from .console import say

WIDGETS = "application/vnd.jupyter.widget-state+json"
VIEW = "application/vnd.jupyter.widget-view+json"
LONGEST_CELL = 1200  # seconds
SLIDES = "slides"  # folder of the chapters' pictures
REFERENCE = "IPY_MODEL_"
PARTS = ("HTMLModel", "ImageModel", "VBoxModel", "HBoxModel")  # of a panel, that a page can show
FORMULA = re.compile(r"(```.*?```|`[^`\n]*`)|\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{style}
body {{ max-width: 1010px; margin: 24px auto; padding: 0 12px; font: 15px/1.5 sans-serif; color: #222 }}
pre {{ font: 13px/1.35 monospace; overflow-x: auto }} img {{ max-width: 100% }}
.jp-InputArea, .highlight {{ background: #f6f6f6; padding: 2px 10px }}
.prompt, .jp-InputPrompt, .jp-OutputPrompt, .anchor-link {{ display: none }}
table {{ border-collapse: collapse }}
td, th {{ padding: 2px 10px; border-bottom: 1px solid #ddd; text-align: left }}
/* Without a font for formulas Chromium draws subscripts on the line. */
math {{ font-family: "Cambria Math", "STIX Two Math", "Latin Modern Math", "DejaVu Math TeX Gyre", math }}
math[display="block"] {{ margin: 12px 0 }} .panel {{ border: 1px solid #bbb; padding: 8px }}
</style></head><body>{body}</body></html>
"""


def write_pages(source: Path, target: Path) -> int:
    """Execute every notebook below `source`; write it, and the texts beside them, as pages into `target`.

    What the chapters show is in `target / SLIDES` as well, as PNG and, of charts, SVG. Cells that failed are
    named; their number is returned.
    """
    paths = sorted([*source.glob("*.ipynb"), *source.glob("solutions/*.ipynb"), *source.glob("*.md")])
    places = [(target / path.relative_to(source)).with_suffix(".html") for path in paths]
    pictures = [path for path in source.glob("images/*") if path.is_file()]
    copies = [target / path.relative_to(source) for path in pictures]
    require_own(*places, *copies)
    notebooks, failed = [_read(path) for path in paths], 0
    for path, place, notebook in zip(paths, places, notebooks, strict=True):
        name = path.relative_to(source)
        say(f"{name} …")
        shown = path.stem if path.parent == source else ""
        slides = executed(notebook, source, shown) if path.suffix == ".ipynb" else {}
        (target / SLIDES).mkdir(parents=True, exist_ok=True)
        for file, data in slides.items():
            write_result(target / SLIDES / file, data)
        for number, cell in enumerate(notebook.cells):
            if any(output.output_type == "error" for output in cell.get("outputs", [])):
                say(f"{name}: cell {number} failed")
                failed += 1
        place.parent.mkdir(parents=True, exist_ok=True)
        write_result(place, portable(page(notebook, path.stem), source.resolve().parent))
    for path, place in zip(pictures, copies, strict=True):
        place.parent.mkdir(exist_ok=True)
        write_result(place, path.read_bytes())
    say(f"open {target / '00_start_here.html'}")
    return failed


def _read(path: Path) -> Any:
    """A notebook, or a text as one; `DataError` where the file is damaged."""
    if path.suffix == ".md":
        text = nbformat.v4.new_markdown_cell(path.read_text(encoding="utf-8"))  # type: ignore[no-untyped-call]
        return nbformat.v4.new_notebook(cells=[text])  # type: ignore[no-untyped-call]
    try:
        return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    except Exception as error:  # of JSON, of its schema, of versions: they share no other base
        raise DataError(f"is no notebook: {str(error).splitlines()[0][:100]}", path) from None


def portable(text: str, kit: Path) -> str:
    """A page without this machine's folders: the kit's is written as `.`, the user's as `~`."""
    for folder, short in ((kit, "."), (Path.home(), "~")):
        if folder.name:  # not the root, as a container's user may have it
            text = text.replace(html.escape(str(folder)), short)
    return text


def executed(notebook: Any, beside: Path, slides: str = "") -> dict[str, bytes]:
    """Give a notebook its outputs and errors; it runs in an empty folder and imports what lies `beside`.

    Returns the files of its pictures by name, where there is a name for `slides`.
    """
    with tempfile.TemporaryDirectory() as folder:
        about = {"metadata": {"path": folder}}
        client = nbclient.NotebookClient(
            notebook, timeout=LONGEST_CELL, kernel_name="python3", allow_errors=True, resources=about
        )
        client.extra_arguments = ["--log-level=ERROR"]  # the kernel's warnings say nothing to a reader
        if slides:
            line = f"from course.slides import export; export({SLIDES!r}, {slides!r})"
            client.extra_arguments.append(f"--IPKernelApp.exec_lines={line}")
        paths = [str(beside), os.environ.get("PYTHONPATH", "")]
        client.execute(env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))})
        return {path.name: path.read_bytes() for path in sorted(Path(folder).glob(f"{SLIDES}/*"))}


def page(notebook: Any, title: str) -> str:
    """A notebook as one page: formulas as MathML, panels as the picture and the words they show."""
    state = notebook.metadata.pop("widgets", {}).get(WIDGETS, {}).get("state", {})
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            text = re.sub(r"\]\((?!\w+://)([^)#\s]+)\.(?:ipynb|md)", r"](\1.html", cell.source)
            cell.source = with_mathml(text)
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if VIEW in data:
                shown = "".join(_shown(state, data[VIEW]["model_id"]))
                output["data"] = {"text/html": f'<div class="panel">{shown}</div>' if shown else ""}
    exporter = HTMLExporter(template_name="basic")  # type: ignore[no-untyped-call]
    body, _ = exporter.from_notebook_node(notebook)
    style = HtmlFormatter().get_style_defs(".highlight")
    return PAGE.format(title=html.escape(title), style=style, body=body)


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
        return re.sub(r"<mo>(&#x0(?:007C|2016);)</mo>", r'<mo stretchy="false">\1</mo>', made).replace(
            "|", "&#124;"
        )

    return FORMULA.sub(drawn, markdown)


def _shown(state: dict[str, Any], model: str) -> list[str]:
    """Pictures and words of a widget and of all that it holds but controls, as HTML."""
    widget = state.get(model, {"state": {}})
    values, name = widget["state"], widget.get("model_name")
    if values.get("layout", "").startswith(REFERENCE):
        layout = state.get(values["layout"].removeprefix(REFERENCE), {"state": {}})["state"]
        if layout.get("display") == "none":
            return []
    if name == "ImageModel":
        data = next(each["data"] for each in widget["buffers"] if each["path"] == ["value"])
        return [f'<img alt="the panel" src="data:image/{values["format"]};base64,{data}">']
    if name == "HTMLModel":
        return [str(values.get("value", ""))]
    children = [child.removeprefix(REFERENCE) for child in values.get("children", [])]
    if children and state.get(children[0], {}).get("model_name") not in PARTS:
        return []  # a control and its caption, which says nothing without it
    return [part for child in children for part in _shown(state, child)]
