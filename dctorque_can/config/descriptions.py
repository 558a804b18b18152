"""What the keys of a vehicle file mean: the docstrings that stand below the fields of its sections.

pydantic can read them too (``use_attribute_docstrings``), but for every section whenever the package is imported,
which is a third of a second. They are wanted when a key is missing.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from functools import cache

from pydantic import BaseModel


@cache
def field_descriptions(model: type[BaseModel]) -> dict[str, str]:
    """Return the docstring of each field by its name, also of inherited ones; fields without one are left out."""
    found: dict[str, str] = {}
    for parent in reversed(model.__mro__):
        if issubclass(parent, BaseModel) and parent is not BaseModel:
            found |= _own_descriptions(parent)
    return {name: text for name, text in found.items() if name in model.model_fields}


def _own_descriptions(model: type[BaseModel]) -> dict[str, str]:
    try:
        lines, _ = inspect.getsourcelines(model)
    except OSError:  # installed without sources: an error then names the key alone
        return {}
    (definition,) = ast.parse(textwrap.dedent("".join(lines))).body
    assert isinstance(definition, ast.ClassDef)
    pairs = zip(definition.body, definition.body[1:], strict=False)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairs
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }
