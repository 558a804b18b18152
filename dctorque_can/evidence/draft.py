"""A vehicle file as it would be with some values corrected."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import Any

from dctorque_can.config.document import Document, parse, shown
from dctorque_can.config.load import OVERRIDES_SUFFIX, Config, load_documents
from dctorque_can.config.overrides import apply_overrides
from dctorque_can.config.vehicle_class import take_sigmas
from dctorque_can.pipeline.samples import Quantity

Fix = tuple[tuple[str, str], ...]
"""Values as YAML by their dotted keys."""


def number(value: float, digits: int = 4) -> str:
    """Return a number as it is written into a vehicle file."""
    return f"{float(f'{value:.{digits}g}'):.12g}"


class Draft:
    """A configuration and the document behind it, to which corrections are laid.

    Args:
        config: as it was loaded.
        fixes: values that are laid over it.

    Raises:
        ConfigError: the file with these values cannot be used.

    Attributes:
        config: with the corrections.
        fixes: these, as YAML by dotted key.
    """

    def __init__(self, config: Config, fixes: Mapping[str, str] | None = None) -> None:
        self._base = config
        self.fixes = dict(fixes or {})
        self.config = load_documents(config.documents, self.fixes) if self.fixes else config
        self._document = _document(self.config)

    def corrected(self, fixes: Iterable[tuple[str, str]]) -> Draft:
        """Return the draft with more corrections.

        Raises:
            ConfigError: the file cannot be used then.
        """
        return Draft(self._base, self.fixes | dict(fixes))

    def value(self, key: str) -> Any:
        """Return what stands at a dotted key, None if nothing does."""
        path = tuple(int(step) if step.isdigit() else step for step in key.split("."))
        return self._document.value(path)

    def key_of(self, quantity: Quantity) -> str:
        """Return the dotted key of an input.

        Raises:
            KeyError: it is not mapped.
        """
        for entry in self.config.entries:
            if entry.input.quantity is quantity:
                return entry.key
        raise KeyError(quantity.name)

    def honest(self, key: str, share: float) -> float:
        """Return how sure a number of the file is, as a share: as file or class tell, at least ``share``."""
        value = self.value(key)
        told = self.config.sigmas.get(key)
        known = told is not None and isinstance(value, int | float) and value
        return max(share, told / abs(value)) if known and told is not None else share

    def unit(self, quantity: Quantity) -> str:
        """Return the unit of an input's first signal, as it is given or as the DBC has it."""
        return next(entry.units[0] for entry in self.config.entries if entry.input.quantity is quantity)

    def scaled(self, quantity: Quantity, factor: float) -> Fix:
        """Return what multiplies an input with a factor."""
        key = self.key_of(quantity)
        section = self.value(key)
        if isinstance(section, dict) and isinstance(section.get("sum"), list):
            fixes: list[tuple[str, str]] = []
            for n, term in enumerate(section["sum"]):
                fixes += _scaled(f"{key}.sum.{n}", term, factor)
            return tuple(fixes)
        return _scaled(key, section, factor)

    def shifted(self, quantity: Quantity, offset: float) -> Fix:
        """Return what adds an offset, in the unit of the signal, to an input; nothing for a product or a sum."""
        key = self.key_of(quantity)
        section = self.value(key)
        if isinstance(section, str):
            return ((key, shown({"signal": section, "offset": float(number(offset))})),)
        if not isinstance(section, dict) or not isinstance(section.get("signal"), str):
            return ()
        return ((f"{key}.offset", number(float(section.get("offset", 0.0)) + offset)),)

    def taken_from(self, quantity: Quantity, total: float) -> Fix:
        """Return what makes an input ``total`` less what it is, in its unit; nothing for a product or a sum."""
        key = self.key_of(quantity)
        section = self.value(key)
        if isinstance(section, str):
            return ((key, shown({"signal": section, "factor": -1.0, "offset": total})),)
        if not isinstance(section, dict) or not isinstance(section.get("signal"), str):
            return ()
        if "times" in section or "divided_by" in section:
            return ()
        factor, offset = (
            float(section.get(name, default)) for name, default in (("factor", 1.0), ("offset", 0.0))
        )
        return ((f"{key}.factor", number(-factor, 6)), (f"{key}.offset", number(total - offset, 6)))

    def with_key(self, quantity: Quantity, name: str, value: str) -> Fix:
        """Return what sets one key of an input."""
        key = self.key_of(quantity)
        section = self.value(key)
        if isinstance(section, str):
            return ((key, f"{{signal: {section}, {name}: {value}}}"),)
        return ((f"{key}.{name}", value),)

    def exchanged(self, first: str, second: str) -> Fix:
        """Return what exchanges the signals of two inputs with these keys; all of both where more differs."""
        one, other = self.value(first), self.value(second)
        if one is None or other is None:
            return ()
        if isinstance(one, dict) and isinstance(other, dict):
            rest = [{k: v for k, v in each.items() if k != "signal"} for each in (one, other)]
            if rest[0] == rest[1] and "signal" in one and "signal" in other:
                return ((f"{first}.signal", shown(other["signal"])), (f"{second}.signal", shown(one["signal"])))
        return ((first, shown(other)), (second, shown(one)))


def _scaled(key: str, section: Any, factor: float) -> Fix:
    if isinstance(section, str):
        return ((key, f"{{signal: {section}, factor: {number(factor, 6)}}}"),)
    fixes = [(f"{key}.factor", number(float(section.get("factor", 1.0)) * factor, 6))]
    if section.get("offset"):
        fixes.append((f"{key}.offset", number(float(section["offset"]) * factor, 6)))
    return tuple(fixes)


def _document(config: Config) -> Document:
    """Return the vehicle file of a configuration with what was laid over it."""
    names = [n for n in config.documents if n.endswith((".yaml", ".yml")) and not n.endswith(OVERRIDES_SUFFIX)]
    document = parse(config.documents[names[0]], names[0])
    laid = PurePath(names[0]).stem + OVERRIDES_SUFFIX
    if laid in config.documents:
        stored = parse(config.documents[laid], laid)
        apply_overrides(document, {str(key): str(value) for key, value in stored.data.items()})
    take_sigmas(document)
    return document
