"""Settings that `--set` changes, and the blocks of a table: the presets, or the presets with other values."""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from .. import settings
from ..config import SETTINGS, change, preset
from ..errors import DataError, did_you_mean
from ..paper.settings import MethodConfig

Axes = dict[str, tuple[Any, ...]]  # values of each setting, by dotted name; the last changes fastest
Changes = tuple[tuple[str, Any], ...]  # names of settings and their values
LONGEST_NAME = 100  # characters of a folder's name
LOOP_SETTINGS = "reprojection."  # the places of loops are compared with these settings of the method


def parse_axis(text: str, config: MethodConfig) -> tuple[str, tuple[Any, ...]]:
    """Name and values in a text such as "selection.sets=50,100,200"; semicolons separate values with commas.

    config : a configuration of the variant that has the setting.

    Raises `DataError` for an unknown setting or an invalid value.
    """
    name, equals, rest = text.partition("=")
    item = (SETTINGS | {item.name: item for item in settings.declared(type(config))}).get(name)
    if name == "seed":
        raise DataError("--set seed: all cells have the same seeds; set the number of seeds with --seeds")
    if item is None or not equals:
        near = did_you_mean(name, SETTINGS) if item is None else ""
        page = f"`vo run --variant {config.variant} --help-settings`"
        raise DataError(f"--set {text!r}: {near}expected SETTING=VALUE,VALUE,… with a setting of {page}")
    values = tuple(item.parse(word) for word in rest.split(";" if isinstance(item.default, tuple) else ","))
    for value in values:
        change(config, name, value)  # raises for a setting or value of the other variant
    if len(set(values)) < len(values):
        raise DataError(f"--set {text!r}: a value is repeated")
    return name, values


def parse_axes(texts: Iterable[str], config: MethodConfig) -> Axes:
    """The axes of several texts as in `parse_axis`; `DataError` for a setting that occurs twice."""
    axes: Axes = {}
    for text in texts:
        name, values = parse_axis(text, config)
        if name in axes:
            raise DataError(f"--set {name}: the setting is repeated; give all its values at once")
        axes[name] = values
    return axes


def combinations(axes: Axes) -> list[Changes]:
    """All combinations of the values; without axes, one combination of nothing."""
    return [tuple(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


def changed(config: MethodConfig, changes: Changes) -> MethodConfig:
    """A configuration with changes; `DataError` for settings that contradict each other."""
    for name, value in changes:
        config = change(config, name, value)
    return config


def differences(config: MethodConfig, usual: MethodConfig) -> Changes:
    """The settings of a configuration, other than the seed, that differ from those of another one."""
    items = []
    for item in settings.declared(type(config)):
        value = settings.value_of(config, item.name)
        if item.name != "seed" and value != settings.value_of(usual, item.name):
            items.append((item.name, value))
    return tuple(items)


def settings_words(changes: Iterable[tuple[str, Any]]) -> str:
    """Changes as one types them: "selection.threshold=1.0, selection.sets=50"."""
    return ", ".join(f"{name}={settings.as_typed(value)}" for name, value in changes)


def settings_folder(changes: Iterable[tuple[str, Any]]) -> str:
    """A folder's name for changes; other changes have another name."""
    text = "+".join(f"{name}={settings.as_typed(value)}" for name, value in changes)
    name = re.sub(r"[^\w.=+-]+", "_", text)  # a class name may have any letter
    if name == text and len(name) <= LONGEST_NAME:
        return name
    return f"{name[:LONGEST_NAME]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


@dataclass(frozen=True)
class Block:
    """A part of a table: the methods of a variant with their presets, changed in the same settings.

    `loops` : whether loops are closed after the runs, with the settings `LOOP_SETTINGS` of every method.
    """

    variant: str
    changes: Changes = ()
    loops: bool = False

    @property
    def words(self) -> str:
        """The changes as one types them; empty for the presets."""
        return settings_words(self.changes)

    def unused(self, method: str) -> dict[str, str]:
        """The changed settings that have no effect on a method, and why."""
        config = changed(preset(method, variant=self.variant), self.changes)
        reasons = {}
        for name, _ in self.changes:
            reason = settings.unused_because(config, name)
            if reason and not (self.loops and name.startswith(LOOP_SETTINGS)):
                reasons[name] = reason
        return reasons

    def used(self, method: str) -> Changes:
        """The changes that have an effect on a method and are not its preset."""
        usual = preset(method, variant=self.variant)
        unused = self.unused(method)
        return tuple(
            (name, value)
            for name, value in self.changes
            if name not in unused and value != settings.value_of(usual, name)
        )

    def config(self, method: str) -> MethodConfig:
        """The configuration of a method: its preset with the changes that have an effect on it.

        So a method on which no change has an effect has the runs of its preset.
        """
        return changed(preset(method, variant=self.variant), self.used(method))

    def described(self, methods: Iterable[str]) -> list[str]:
        """For each changed setting, a sentence on what differs from the presets of the methods."""
        sentences = []
        for name, value in self.changes:
            of_preset: dict[str, list[str]] = {}
            unused: dict[str, list[str]] = {}
            for method in methods:
                reason = self.unused(method).get(name)
                usual = settings.value_of(preset(method, variant=self.variant), name)
                if reason:
                    unused.setdefault(reason, []).append(method)
                else:
                    of_preset.setdefault(settings.as_typed(usual), []).append(method)
            words = []
            for usual_words, which in of_preset.items():
                same = usual_words == settings.as_typed(value)
                was = "as in the presets" if same else f"instead of {usual_words}"
                words.append(was if len(of_preset) == 1 else f"{was} in {', '.join(which)}")
            sentence = f"{name} is {settings.as_typed(value)}"
            if words:
                sentence += f", {'; '.join(words)}"
            for reason, which in unused.items():
                verb = "does" if len(which) == 1 else "do"
                sentence += f"; {', '.join(which)} {verb} not use it, since {reason}"
            sentences.append(f"{sentence}.")
        return sentences


def make_blocks(
    methods: Mapping[str, list[str]],
    base: Changes,
    axes: Axes,
    loops: bool = False,
    refused: Iterable[str] = (),
) -> list[Block]:
    """A block for each variant with methods and each combination of the values on the axes.

    base : changes in every block, which a value on an axis replaces; refused : names of those that a method
    must use.

    Raises `DataError` if no method uses a setting of an axis or of `refused`, or if changes make two methods
    the same.
    """
    blocks = []
    for variant, of_variant in methods.items():
        if not of_variant:
            continue
        for values in combinations(axes):
            changes = tuple((dict(base) | dict(values)).items())
            blocks.append(Block(variant, changes, loops))
    for name in dict.fromkeys([*axes, *refused]):
        reasons = []
        for block in blocks:
            of_variant = methods[block.variant]
            reasons += [(method, block.unused(method).get(name, "")) for method in of_variant]
        if reasons and all(reason for _, reason in reasons):
            who = {method for of_variant in methods.values() for method in of_variant}
            words = f"{who.pop()} does not use" if len(who) == 1 else "no method of the table uses"
            raise DataError(f"{name}: {words} this setting, since {reasons_words(reasons)}")
    for block in blocks:
        _refuse_equal_methods(block, methods[block.variant])
    return blocks


def reasons_words(reasons: Iterable[tuple[str, str]]) -> str:
    """Why methods do not use a setting, from pairs of a method and a reason; a common reason stands alone."""
    methods_of: dict[str, list[str]] = {}
    for method, reason in dict.fromkeys(reasons):
        methods_of.setdefault(reason, []).append(method)
    if len(methods_of) == 1:
        return next(iter(methods_of))
    return ", and ".join(f"{reason} ({', '.join(methods)})" for reason, methods in methods_of.items())


def _refuse_equal_methods(block: Block, methods: list[str]) -> None:
    """Raise `DataError` if the changes make two methods the same: one would be shown under two names."""
    seen: dict[Changes, str] = {}
    for method in methods:
        effective = _effective(block.config(method))
        if effective in seen:
            raise DataError(
                f"with {block.words}, {seen[effective]} and {method} are the same method: choose one of them "
                "with --methods"
            )
        seen[effective] = method


def _effective(config: MethodConfig) -> Changes:
    """The settings that a configuration uses, with their values."""
    return tuple(
        (item.name, settings.value_of(config, item.name))
        for item in settings.declared(type(config))
        if not settings.unused_because(config, item.name)
    )
