"""What all sections of a vehicle file share: strict, frozen models and readable errors."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from dctorque_can.config.descriptions import field_descriptions
from dctorque_can.config.document import Document
from dctorque_can.config.problems import KeyPath, Problem

S = TypeVar("S", bound="Section")


class Section(BaseModel):
    """A mapping of a vehicle file. Unknown keys, missing keys, wrong types and non-finite numbers are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:
        """Yield (key path below this section, reason) for values that are right alone but not together."""
        yield from ()


def absent(value: object) -> bool:
    """Return whether a section has nothing in it, as if its key were not there."""
    return value is None or value == {} or value == []


def validate(document: Document, path: KeyPath, model: type[S]) -> S | None:
    """Read what stands at ``path`` as ``model``; every error goes to ``document.problems``.

    Values that contradict each other are found also in the sound parts of a section that has errors elsewhere.

    Returns:
        None when there was an error.
    """
    data = document.value(path)
    section: S | None = None
    try:
        section = model.model_validate(data if data is not None else {})
    except ValidationError as failure:
        for error in failure.errors(include_url=False):
            at = (*path, *(step for step in error["loc"] if step != "[key]"))
            document.problems.append(document.problem(at, _reason(model, error)))
    contradictions = [
        ((*at, *below), reason)
        for at, part in sound_parts(model, data, path)
        for below, reason in part.contradictions()
    ]
    document.problems += [document.problem(at, reason) for at, reason in contradictions]
    return None if contradictions else section


def sound_parts(
    model: type[Section], data: Any, path: KeyPath, *, repair: bool = False
) -> Iterator[tuple[KeyPath, Section]]:
    """Yield every section at or below ``path`` that is free of errors, with its key path.

    With ``repair`` also those that are free of errors once their faulty keys are left out. Nothing is reported:
    `validate` has done that.
    """
    try:
        yield path, model.model_validate(data)
    except ValidationError as failure:
        if repair and isinstance(data, dict):
            faulty = {error["loc"][0] for error in failure.errors() if error["loc"]}
            with suppress(ValidationError):
                yield path, model.model_validate({key: item for key, item in data.items() if key not in faulty})
    if not isinstance(data, dict):
        return
    for name, field in model.model_fields.items():
        below, value = _bare(field.annotation), data.get(name)
        if isinstance(below, type) and issubclass(below, Section):
            yield from sound_parts(below, value, (*path, name), repair=repair)
        elif get_origin(below) in (dict, list) and isinstance(value, dict | list):
            item = _bare(get_args(below)[-1])
            if isinstance(item, type) and issubclass(item, Section):
                for key, one in value.items() if isinstance(value, dict) else enumerate(value):
                    yield from sound_parts(item, one, (*path, name, key), repair=repair)


def nearest(word: str, words: Iterable[str]) -> str:
    """Return "; did you mean …?" with the most similar of ``words``, or what there is to choose from."""
    choice = sorted(words)
    lowered = {known.casefold(): known for known in choice}
    found = difflib.get_close_matches(word.casefold(), lowered, n=2, cutoff=0.55)
    if found:
        return f"; did you mean {' or '.join(lowered[near] for near in found)}?"
    return f"; there is: {', '.join(choice)}" if choice else ""


def _reason(model: type[BaseModel], error: ErrorDetails) -> str:
    """Return pydantic's error in the words of a vehicle file."""
    context = error.get("ctx", {})
    match error["type"]:
        case "missing":
            described = _description(model, error["loc"])
            return "missing" + (f": {described.rstrip(chr(46))}" if described else "")
        case "extra_forbidden":
            parent = _model_at(model, error["loc"][:-1])
            return "unknown key" + nearest(str(error["loc"][-1]), parent.model_fields if parent else ())
        case "model_type" | "model_attributes_type" | "dict_type":
            return "must be a mapping of keys to values"
        case "literal_error":
            return f"must be one of: {context['expected'].replace(chr(39), '')}"
        case "finite_number":
            return "must be a finite number"
        case "float_type":
            return "must be a number"
        case "int_type" | "int_from_float":
            return "must be a whole number"
        case "bool_type":
            return "must be true or false"
        case "string_type":
            return "must be text"
        case "list_type":
            return "must be a list: [ … ]"
        case "value_error":
            return str(context["error"])
    return error["msg"].replace("Input should be", "must be")


def _description(model: type[BaseModel], location: tuple[str | int, ...]) -> str:
    parent = _model_at(model, location[:-1])
    return field_descriptions(parent).get(str(location[-1]), "") if parent else ""


def _model_at(model: type[BaseModel], location: Iterable[str | int]) -> type[BaseModel] | None:
    """Return the model that describes the mapping at ``location`` below ``model``."""
    annotation: Any = model
    for step in location:
        annotation = _bare(annotation)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            field = annotation.model_fields.get(str(step))
            if field is None:
                return None
            annotation = field.annotation
        elif get_origin(annotation) in (dict, list):
            annotation = get_args(annotation)[-1]
        else:
            return None
    annotation = _bare(annotation)
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None


def _bare(annotation: Any) -> Any:
    """Take ``Annotated`` and ``| None`` off an annotation."""
    while get_origin(annotation) in (Annotated, Union, UnionType):
        options = get_args(annotation)
        if get_origin(annotation) is Annotated:
            annotation = options[0]
        else:
            annotation = next(option for option in options if option is not type(None))
    return annotation


def problem_order(problem: Problem) -> tuple[bool, str, int, str]:
    """Sort key: errors first, then by place."""
    return (problem.severity == "warning", problem.file, problem.line, problem.key)
