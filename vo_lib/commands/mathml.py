"""The formulas of the notebooks as MathML, which browsers draw without a script and without a network."""

from __future__ import annotations

import html
import re

TOKEN = re.compile(r"\\[a-zA-Z]+|\\.|\d+(?:\.\d+)?|\s+|.", re.DOTALL)
FORMULA = re.compile(r"(```.*?```|`[^`\n]*`)|\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
SYMBOLS = {
    "alpha": "α", "beta": "β", "delta": "δ", "Delta": "Δ", "tau": "τ", "sigma": "σ", "theta": "θ", "pi": "π",
    "psi": "ψ",
    "times": "×", "cdot": "·", "top": "⊤", "sum": "∑", "approx": "≈", "le": "≤", "ge": "≥", "neq": "≠",
    "lVert": "‖", "rVert": "‖", "lvert": "|", "rvert": "|", "cap": "∩", "cup": "∪", "in": "∈", "to": "→",
    "ldots": "…", "dots": "…", "pm": "±", "angle": "∠", "infty": "∞", "rightarrow": "→", "{": "{", "}": "}",
    "|": "‖", "%": "%", "_": "_", "lambda": "λ", "Vert": "‖", "vert": "|", "mid": "|", "circ": "°",
}  # fmt: skip
WORDS = {"arccos", "cos", "sin", "min", "max", "det", "ln", "log"}
SPACES = {
    ",": "0.17em",
    ";": "0.28em",
    ":": "0.22em",
    " ": "0.25em",
    "quad": "1em",
    "qquad": "2em",
    "!": "0em",
}
ACCENTS = {"hat": "^", "tilde": "~", "bar": "¯"}
TEXTS = {"mathrm", "text", "mathit", "operatorname", "mathbf"}
SIZES = {"left", "right", "big", "Big", "bigl", "bigr", "Bigl", "Bigr", "displaystyle"}
ENDS = {"}", "&", "\\\\", "\\end", ""}


def with_mathml(markdown: str) -> str:
    """Markdown whose formulas, between $ or $$, are MathML; code stays as it is."""

    def drawn(found: re.Match[str]) -> str:
        code, display, inline = found.groups()
        return code or (to_mathml(display, block=True) if display else to_mathml(inline))

    return FORMULA.sub(drawn, markdown)


def to_mathml(tex: str, block: bool = False) -> str:
    """A formula; `ValueError` where it has a command that is not known here."""
    reader = _Reader(tex)
    row = reader.row()
    if reader.token:
        raise ValueError(f"{tex!r}: {reader.token!r} ends nothing")
    display = ' display="block"' if block else ""
    return f"<math{display}>{row}</math>"


class _Reader:
    """Reads a formula token by token."""

    def __init__(self, tex: str):
        self.tex, self.tokens, self.at = tex, [t for t in TOKEN.findall(tex) if not t.isspace()], 0

    @property
    def token(self) -> str:
        """The next token; "" at the end."""
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def take(self) -> str:
        """The next token, read."""
        self.at += 1
        return self.tokens[self.at - 1] if self.at <= len(self.tokens) else ""

    def row(self) -> str:
        """What stands up to the end of a group, a cell or the formula."""
        parts = []
        while self.token not in ENDS:
            base, scripts = self.atom(), {}
            while self.token in ("^", "_"):
                sign = self.take()
                scripts[sign] = self.argument()
            if len(scripts) == 2:
                base = f"<msubsup>{base}{scripts['_']}{scripts['^']}</msubsup>"
            elif scripts:
                [(sign, script)] = scripts.items()
                base = f"<msub>{base}{script}</msub>" if sign == "_" else f"<msup>{base}{script}</msup>"
            parts.append(base)
        return f"<mrow>{''.join(parts)}</mrow>"

    def argument(self) -> str:
        """A group, or a single token; of a number its first digit."""
        if self.token[:1].isdigit() and len(self.token) > 1:
            self.tokens[self.at : self.at + 1] = [self.token[0], self.token[1:]]
        return self.atom()

    def atom(self) -> str:
        """One thing without its scripts."""
        token = self.take()
        if token == "{":
            inside = self.row()
            self.take()
            return inside
        if not token.startswith("\\"):
            if token[:1].isdigit() or token.isalpha():
                kind = "mi" if token.isalpha() else "mn"
                return f"<{kind}>{token}</{kind}>"
            return f'<mo stretchy="false">{html.escape("−" if token == "-" else token)}</mo>'
        name = token[1:]
        if name in ("frac", "tfrac", "dfrac"):
            return f"<mfrac>{self.argument()}{self.argument()}</mfrac>"
        if name == "sqrt":
            return f"<msqrt>{self.argument()}</msqrt>"
        if name in ACCENTS:
            return f'<mover accent="true">{self.argument()}<mo>{ACCENTS[name]}</mo></mover>'
        if name in TEXTS:
            return f'<mi mathvariant="normal">{html.escape(self.raw())}</mi>'
        if name == "begin":
            return self.table(self.raw())
        if name in SIZES:
            return self.atom() if self.token != "." else self.take() and ""
        if name in SPACES:
            return f'<mspace width="{SPACES[name]}"/>'
        if name in WORDS:
            return f"<mi>{name}</mi>"
        if name in SYMBOLS:
            kind = "mi" if SYMBOLS[name].isalpha() else 'mo stretchy="false"'
            return f"<{kind}>{html.escape(SYMBOLS[name])}</{kind[:2]}>"
        raise ValueError(f"{self.tex!r}: the command {token} is not known")

    def raw(self) -> str:
        """The letters of a group; what they are in the formula, spaces included."""
        start = self.at
        while self.take() not in ("}", ""):
            pass
        words = "".join(self.tokens[start + 1 : self.at - 1])
        # Spaces were dropped with the tokens: find the group in the text.
        found = re.search(r"\{(\s*" + r"\s*".join(map(re.escape, words)) + r"\s*)\}", self.tex)
        return found[1] if found else words

    def table(self, kind: str) -> str:
        """The rows and cells of an environment."""
        rows: list[list[str]] = [[]]
        while True:
            rows[-1].append(f"<mtd>{self.row()}</mtd>")
            end = self.take()
            if end == "\\\\":
                rows.append([])
            elif end != "&":
                break
        self.raw()
        body = "".join(f"<mtr>{''.join(cells)}</mtr>" for cells in rows)
        fence = ("<mo>(</mo>", "<mo>)</mo>") if kind == "pmatrix" else ("", "")
        return f"<mrow>{fence[0]}<mtable>{body}</mtable>{fence[1]}</mrow>"
