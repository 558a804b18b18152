"""Which vehicle a state is of: the file as it is, with all that its class and the overrides laid over it."""

from __future__ import annotations

import hashlib

import yaml

from dctorque_can.config.load import OVERRIDES_SUFFIX, Config

_EDGES = ("name", "can", "output", "logging", "status", "state", "clutch_map")
"""Sections whose overrides change nothing of what is estimated or learned."""


def vehicle_digest(config: Config) -> str:
    """Return a word for all that the vehicle is: SHA-256 in hexadecimal digits.

    That is the vehicle file with what its class of cars gave it, and the overrides that matter.
    """
    digest = hashlib.sha256(config.documents[config.path.name])
    laid_over = config.documents.get(config.path.stem + OVERRIDES_SUFFIX)
    values = yaml.safe_load(laid_over) if laid_over else {}
    for key in sorted(values):
        if str(key).split(".")[0] not in _EDGES:
            digest.update(f"\0{key}\0{values[key]}".encode())
    for key in sorted(config.of_class):
        digest.update(f"\0{key}\0{config.of_class[key]!r}".encode())
    return digest.hexdigest()


def database_digest(config: Config) -> str:
    """Return a word for what the frames mean: SHA-256 of all databases."""
    digest = hashlib.sha256()
    for name in sorted(config.documents):
        if not name.endswith((".yaml", ".yml")):
            digest.update(name.encode() + b"\0" + hashlib.sha256(config.documents[name]).digest())
    return digest.hexdigest()
