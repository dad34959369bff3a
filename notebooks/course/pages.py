"""The executed notebooks and the texts beside them as HTML pages, readable without Python or a network.

    python -m course.pages DIR

Run the command in the folder of the notebooks. nbconvert makes the pages. Formulas are MathML, without a
script from the network; a panel is shown as its picture and text.
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

from vo_lib.commands.console import ENDINGS, OneLineParser, exit_code
from vo_lib.errors import DataError
from vo_lib.files import write_atomic

from .minutes import FOLDED
from .notebook_folder import NOTEBOOKS

WIDGETS = "application/vnd.jupyter.widget-state+json"
VIEW = "application/vnd.jupyter.widget-view+json"
CELL_TIMEOUT_S = 1200
REFERENCE = "IPY_MODEL_"
PARTS = ("HTMLModel", "ImageModel", "VBoxModel", "HBoxModel")  # parts of a panel that a page can show
OPTIONAL = re.compile(r"^(#+ .*)", re.MULTILINE)  # the heading of a section that JupyterLab shows folded
PANEL_ALT = 'alt="the panel"'
MATHML = re.compile(r'<span class="formula"><math.*?</math></span>|<math.*?</math>', re.DOTALL)
STAND_IN = re.compile(r"formula\d{5}formula")  # a word in place of a formula
FORMULA = re.compile(r"(```.*?```|`[^`\n]*`)|\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}</title><style>{style}
body {{ max-width: 1010px; margin: 24px auto; padding: 0 12px; font: 15px/1.5 sans-serif; color: #222 }}
pre {{ font: 13px/1.35 monospace; overflow-x: auto }}
img, video, iframe {{ max-width: 100%; background: #fff }} img, video {{ height: auto }}
.jp-InputArea, .highlight {{ background: #f6f6f6; padding: 2px 10px }} .prompt {{ display: none }}
td, th {{ padding: 2px 10px; border-bottom: 1px solid #8884; text-align: left; vertical-align: top }}
/* In a narrow window, wide tables and formulas scroll, not the page. */
table, .formula {{ display: block; max-width: 100%; overflow-x: auto }}
body {{ overflow-wrap: anywhere }} td, th {{ overflow-wrap: normal }}
/* Without a font for formulas, Chromium draws subscripts on the baseline. */
math {{ font-family: "Cambria Math", "STIX Two Math", "Latin Modern Math", "DejaVu Math TeX Gyre", math }}
math[display="block"] {{ margin: 12px 0 }} .panel {{ border: 1px solid #bbb; padding: 8px }}
@media (prefers-color-scheme: dark) {{
  body {{ background: #1c1c1c; color: #ddd }} a {{ color: #8ab4f8 }} .jp-InputArea, .highlight {{ background: #272822 }}
  {dark}
}}
</style></head><body>{body}</body></html>
"""


def write_pages(source: Path, target: Path) -> int:
    """Write a page into `target` for every notebook and text in `source`; return the number of failed cells.

    Raises `DataError` if a notebook is damaged.
    """
    failed = 0
    target.mkdir(parents=True, exist_ok=True)
    for path in source.glob("*.csv"):  # the pages have links to these tables
        write_atomic(target / path.name, path.read_bytes())
    for path in sorted([*source.glob("*.ipynb"), *source.glob("solutions/*.ipynb"), *source.glob("*.md")]):
        name = path.relative_to(source)
        notebook = read(path)
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
    print(f"open {target / '00_start_here.html'}")
    return failed


def read(path: Path) -> Any:
    """A notebook, or a text as a notebook; `DataError` if the file is damaged."""
    if path.suffix == ".md":
        text = nbformat.v4.new_markdown_cell(path.read_text(encoding="utf-8"))  # type: ignore[no-untyped-call]
        return nbformat.v4.new_notebook(cells=[text])  # type: ignore[no-untyped-call]
    try:
        return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    except Exception as error:  # errors of JSON, schema and version have no other common base
        raise DataError(f"is not a notebook: {str(error).splitlines()[0][:100]}", path) from None


def execute(notebook: Any, beside: Path) -> None:
    """Run a notebook in an empty folder, with the package `course` of the folder `beside`; store its outputs."""
    with tempfile.TemporaryDirectory() as folder:
        where = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, timeout=CELL_TIMEOUT_S, allow_errors=True, resources=where)
        paths = [str(beside), os.environ.get("PYTHONPATH", "")]
        client.execute(env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))})


def page(notebook: Any, path: Path) -> str:
    """An executed notebook as a page with embedded pictures; folders of this machine become `.` and `~`."""
    widgets = notebook.metadata.pop("widgets", {}).get(WIDGETS, {}).get("state", {})
    description = ""  # of the next picture
    formulas = dict[str, str]()
    for cell in notebook.cells:
        if cell.metadata.get(FOLDED):
            cell.source = OPTIONAL.sub(r"\1 *(optional)*", cell.source, count=1)
        if cell.cell_type == "markdown":
            description = _announced(cell.source) or description
            linked = re.sub(r"\]\((?!\w+://)([^)#\s]+)\.(?:ipynb|md)", r"](\1.html", cell.source)
            cell.source = _set_aside(with_mathml(linked), formulas)
        for output in cell.get("outputs", []):
            _describe_pictures(output, description, widgets)
    exporter = HTMLExporter(template_name="basic", embed_images=True, exclude_anchor_links=True)  # type: ignore[no-untyped-call]
    body, _ = exporter.from_notebook_node(notebook, {"metadata": {"path": str(path.parent)}})
    body = re.sub(' id="[^"]*"', lambda found: STAND_IN.sub("", found[0]), body)
    body = STAND_IN.sub(lambda found: formulas[found[0]], body)
    for folder, short in ((NOTEBOOKS.parent, "."), (Path.home(), "~")):
        body = body.replace(f"{html.escape(str(folder))}/", f"{short}/")
    style = HtmlFormatter(style="default").get_style_defs(".highlight")
    dark = HtmlFormatter(style="monokai").get_style_defs(".highlight")
    return PAGE.format(title=html.escape(path.stem), style=style, dark=dark, body=body)


def _describe_pictures(output: Any, description: str, widgets: dict[str, Any]) -> None:
    """Give the pictures of an output their description; a panel becomes its picture and text.

    widgets : state of the notebook's widgets by model.
    """
    data = output.get("data", {})
    for kind in {"image/png", "image/jpeg"} & set(data):
        output.metadata[kind] = {"alt": description, **output.metadata.get(kind, {})}
    if VIEW in data:
        panel = "".join(_picture_and_text(widgets, data[VIEW]["model_id"]))
        title = re.search("<b>(.*?)</b>", panel)
        panel = panel.replace(PANEL_ALT, f'alt="Panel: {title[1] if title else description}"')
        output["data"] = {"text/html": f'<div class="panel">{panel}</div>' if panel else ""}


def with_mathml(markdown: str) -> str:
    """Markdown with formulas (between $ or $$) as MathML, which needs no script; code does not change."""

    def as_mathml(match: re.Match[str]) -> str:
        code, display, inline = match.groups()
        if code:
            return str(code)
        try:
            mathml = convert(display or inline, display="block" if display else "inline")
        except Exception:  # an invalid formula does not change; the errors have no other common base
            return match.group()
        # A single bar would stretch with the formula; as a character, it would end the cell of a table.
        mathml = re.sub(r"<mo>(&#x0(?:007C|2016);)</mo>", r'<mo stretchy="false">\1</mo>', mathml)
        mathml = str(mathml).replace("|", "&#124;")
        return f'<span class="formula">{mathml}</span>' if display else mathml

    return FORMULA.sub(as_mathml, markdown)


def _set_aside(markdown: str, formulas: dict[str, str]) -> str:
    """Markdown with a word in place of each formula; `formulas` gets the formula of each word.

    nbconvert parses each tag of HTML inside a paragraph by itself, and closes it at once: a formula would lose
    its structure.
    """

    def stand_in(match: re.Match[str]) -> str:
        word = f"formula{len(formulas):05d}formula"
        formulas[word] = match.group()
        return word

    return MATHML.sub(stand_in, markdown)


def _announced(markdown: str) -> str:
    """Description of a picture: the last line of the text above if it ends with a colon, else the heading."""
    plain = re.sub(r"[*`$]|\[|\]\([^)]*\)", "", markdown).strip()
    last = plain.split("\n")[-1]
    if last.endswith(":"):
        return last.split(". ")[-1].rstrip(":")
    headings = re.findall(r"^#+ (.*)", plain, re.MULTILINE)
    return str(headings[-1]) if headings else ""


def _picture_and_text(widgets: dict[str, Any], model: str) -> list[str]:
    """Pictures and words of a widget and its children, without controls, as HTML."""
    widget = widgets.get(model, {"state": {}})
    values = widget["state"]
    name = widget.get("model_name")
    if name == "ImageModel":
        data = next(each["data"] for each in widget["buffers"] if each["path"] == ["value"])
        return [f'<img {PANEL_ALT} src="data:image/{values["format"]};base64,{data}">']
    if name == "HTMLModel":
        return [str(values.get("value", ""))]
    children = [child.removeprefix(REFERENCE) for child in values.get("children", [])]
    if children and widgets.get(children[0], {}).get("model_name") not in PARTS:
        return []  # a control and its label
    parts = []
    for child in children:
        parts += _picture_and_text(widgets, child)
    return parts


def main() -> int:
    """Write the pages; return 1 if a cell failed, 2 if a file could not be read or written, else 0."""
    parser = OneLineParser(prog="python -m course.pages", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder for the pages")
    options = parser.parse_args()
    try:
        return min(write_pages(NOTEBOOKS, options.folder), 1)
    except ENDINGS as error:
        return exit_code(parser.prog, error)


if __name__ == "__main__":
    sys.exit(main())
