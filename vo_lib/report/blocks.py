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

# The settings that vary, by dotted name, each with its values. In a table, the values of the last one change
# fastest.
Axes = dict[str, tuple[Any, ...]]
Changes = tuple[tuple[str, Any], ...]  # dotted names of settings, and a value for each
LONGEST_NAME = 100  # characters of a folder's name, without the digest behind a longer one
# The settings whose names begin with this belong to the estimator of viso2. The closing of loops finds the
# motion between two places with them, too, whatever the method of the run.
USED_BY_LOOPS = "reprojection."


def settings_of(config: MethodConfig) -> dict[str, settings.Setting]:
    """The settings of both variants by dotted name; a name that both have stands for this configuration's."""
    own = {item.name: item for item in settings.declared(type(config))}
    return SETTINGS | own


def parse_axis(text: str, config: MethodConfig) -> tuple[str, tuple[Any, ...]]:
    """Name and values in a text such as "selection.sets=50,100,200"; semicolons separate values with commas.

    config : a configuration of the variant that has the setting.

    Raises `DataError` for an unknown setting or an invalid value.
    """
    name, equals, values_text = text.partition("=")
    item = settings_of(config).get(name)
    if name == "seed":
        raise DataError("--set seed: all cells have the same seeds; set the number of seeds with --seeds")
    if item is None or not equals:
        near = did_you_mean(name, SETTINGS) if item is None else ""
        page = f"`vo run --variant {config.variant} --help-settings`"
        raise DataError(f"--set {text!r}: {near}expected SETTING=VALUE,VALUE,… with a setting of {page}")
    separator = ";" if isinstance(item.default, tuple) else ","
    values = tuple(item.parse(word) for word in values_text.split(separator))
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
    """All combinations of the values on the axes; without axes, one combination without changes."""
    every = itertools.product(*axes.values())
    return [tuple(zip(axes, values, strict=True)) for values in every]


def changed(config: MethodConfig, changes: Changes) -> MethodConfig:
    """A configuration with changes; `DataError` for an invalid or a contradictory value."""
    for name, value in changes:
        config = change(config, name, value)
    return config


def differences(config: MethodConfig, usual: MethodConfig) -> Changes:
    """The settings of a configuration, other than the seed, that differ from those of another one."""
    found = []
    for item in settings.declared(type(config)):
        value = settings.value_of(config, item.name)
        if item.name != "seed" and value != settings.value_of(usual, item.name):
            found.append((item.name, value))
    return tuple(found)


def settings_words(changes: Iterable[tuple[str, Any]]) -> str:
    """Changes as one types them: "selection.threshold=1.0, selection.sets=50"."""
    return ", ".join(f"{name}={settings.as_typed(value)}" for name, value in changes)


def settings_folder(changes: Iterable[tuple[str, Any]]) -> str:
    """A folder's name for changes; other changes have another name."""
    words = "+".join(f"{name}={settings.as_typed(value)}" for name, value in changes)
    folder = re.sub(r"[^\w.=+-]+", "_", words)  # a class name may have any letter
    if folder == words and len(folder) <= LONGEST_NAME:
        return folder
    # A name with fewer letters could stand for several changes, so it also has their digest.
    return f"{folder[:LONGEST_NAME]}-{hashlib.sha256(words.encode()).hexdigest()[:8]}"


@dataclass(frozen=True)
class Block:
    """A part of a table: the methods of a variant with their presets, changed in the same settings.

    changes : the settings that differ from the presets. A method that does not use one keeps its preset.
    loops : whether loops are closed after the runs. Then the settings that begin with `USED_BY_LOOPS` have an
        effect on every method.
    """

    variant: str
    changes: Changes = ()
    loops: bool = False

    @property
    def words(self) -> str:
        """The changes as one types them; empty for the presets."""
        return settings_words(self.changes)

    @property
    def key(self) -> tuple[str, str]:
        """The variant and the words, by which the entries of the block are found."""
        return self.variant, self.words

    def unused(self, method: str) -> dict[str, str]:
        """The changed settings that have no effect on a method, and why."""
        config = changed(preset(method, variant=self.variant), self.changes)
        reasons = {}
        for name, _ in self.changes:
            reason = settings.unused_because(config, name)
            if reason and not (self.loops and name.startswith(USED_BY_LOOPS)):
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
        methods = list(methods)
        return [self._described(name, settings.as_typed(value), methods) for name, value in self.changes]

    def _described(self, name: str, value: str, methods: list[str]) -> str:
        """A sentence on a changed setting: its value, those of the presets, and who does not use it."""
        methods_of_preset: dict[str, list[str]] = {}  # by the value in their presets, as typed
        methods_without: dict[str, list[str]] = {}  # by the reason why they do not use the setting
        for method in methods:
            reason = self.unused(method).get(name)
            if reason:
                methods_without.setdefault(reason, []).append(method)
            else:
                usual = settings.value_of(preset(method, variant=self.variant), name)
                methods_of_preset.setdefault(settings.as_typed(usual), []).append(method)
        comparisons = []
        for usual_value, who in methods_of_preset.items():
            words = "as in the presets" if usual_value == value else f"instead of {usual_value}"
            comparisons.append(words if len(methods_of_preset) == 1 else f"{words} in {', '.join(who)}")
        sentence = f"{name} is {value}"
        if comparisons:
            sentence += f", {'; '.join(comparisons)}"
        for reason, who in methods_without.items():
            verb = "does" if len(who) == 1 else "do"
            sentence += f"; {', '.join(who)} {verb} not use it, since {reason}"
        return f"{sentence}."


def make_blocks(
    methods: Mapping[str, list[str]],
    base: Changes,
    axes: Axes,
    loops: bool = False,
    must_be_used: Iterable[str] = (),
) -> list[Block]:
    """A block for each variant with methods and each combination of the values on the axes.

    Parameters
    ----------
    methods : names by variant.
    base : changes in every block, which a value on an axis replaces.
    axes : the values of settings.
    loops : as in `Block`.
    must_be_used : names of settings in `base` that at least one method has to use; those of an axis always
        have to.

    Raises
    ------
    DataError : no method uses a setting that must be used, or changes make two methods the same.
    """
    blocks = []
    for variant, of_variant in methods.items():
        if of_variant:
            for combination in combinations(axes):
                changes = dict(base) | dict(combination)
                blocks.append(Block(variant, tuple(changes.items()), loops))
    for name in dict.fromkeys([*axes, *must_be_used]):
        reasons = []
        for block in blocks:
            for method in methods[block.variant]:
                reasons.append((method, block.unused(method).get(name, "")))
        refuse_if_unused(name, reasons, "no method of the table uses")
    for block in blocks:
        _refuse_equal_methods(block, methods[block.variant])
    return blocks


def refuse_if_unused(name: str, reasons: list[tuple[str, str]], nobody_uses: str) -> None:
    """Raise `DataError` if no method uses a setting.

    reasons : pairs of a method and why it does not use the setting, "" where it does.
    nobody_uses : how the message begins for several methods, such as "no method uses".
    """
    if not reasons or not all(reason for _, reason in reasons):
        return
    methods = {method for method, _ in reasons}
    words = f"{methods.pop()} does not use" if len(methods) == 1 else nobody_uses
    raise DataError(f"{name}: {words} this setting, since {reasons_words(reasons)}")


def reasons_words(reasons: Iterable[tuple[str, str]]) -> str:
    """Why methods do not use a setting, from pairs of a method and a reason; a common reason stands alone."""
    methods_by_reason: dict[str, list[str]] = {}
    for method, reason in dict.fromkeys(reasons):
        methods_by_reason.setdefault(reason, []).append(method)
    if len(methods_by_reason) == 1:
        return next(iter(methods_by_reason))
    return ", and ".join(f"{reason} ({', '.join(who)})" for reason, who in methods_by_reason.items())


def _refuse_equal_methods(block: Block, methods: list[str]) -> None:
    """Raise `DataError` if the changes make two methods the same: one would be shown under two names."""
    method_with: dict[Changes, str] = {}
    for method in methods:
        used = _used_settings(block.config(method))
        if used in method_with:
            raise DataError(
                f"with {block.words}, {method_with[used]} and {method} are the same method: choose one of "
                "them with --methods"
            )
        method_with[used] = method


def _used_settings(config: MethodConfig) -> Changes:
    """The settings that a configuration uses, with their values."""
    return tuple(
        (item.name, settings.value_of(config, item.name))
        for item in settings.declared(type(config))
        if not settings.unused_because(config, item.name)
    )
