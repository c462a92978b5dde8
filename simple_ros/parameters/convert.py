"""Between the tree's values and the messages of `ParameterService`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from simple_ros.errors import InvalidName
from simple_ros.parameters.errors import ParameterError, ParameterTypeMismatch, error_named
from simple_ros.parameters.tree import Change, Declaration, Entry, Origin
from simple_ros.parameters.values import Descriptor, Value, described, type_of
from simple_ros.rpc import parameters_pb2 as par

__all__ = [
    "ParameterInfo",
    "changes_event",
    "declaration_from_proto",
    "declaration_to_proto",
    "description_from_proto",
    "description_to_proto",
    "error_from_proto",
    "parameters_from_proto",
    "parameters_to_proto",
    "problem_of",
    "snapshot_event",
    "value_from_proto",
    "value_to_proto",
]

_FIELDS = {
    "bool": "bool_value",
    "int": "int_value",
    "float": "float_value",
    "string": "string_value",
    "bytes": "bytes_value",
    "bool[]": "bools",
    "int[]": "ints",
    "float[]": "floats",
    "string[]": "strings",
    "bytes[]": "byte_strings",
    "[]": "empty",
}
_ORIGINS = {
    Origin.DEFAULT: par.PARAMETER_ORIGIN_DEFAULT,
    Origin.OVERRIDE: par.PARAMETER_ORIGIN_OVERRIDE,
    Origin.SET: par.PARAMETER_ORIGIN_SET,
}
_ORIGINS_BACK = {number: origin for origin, number in _ORIGINS.items()}


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """All that is known of a parameter.

    Attributes:
        name: Its full name.
        value: What it is now.
        origin: Where that comes from.
        nodes: Names of the live nodes that declare it.
        descriptor: What the first of them says; None if nobody declares it.
        revision: Of the Master's tree, when the value last changed.
    """

    name: str
    value: Value
    origin: Origin
    nodes: tuple[str, ...]
    descriptor: Descriptor | None
    revision: int


# -- values ----------------------------------------------------------------------------------------


def value_to_proto(value: Value) -> par.ParameterValue:
    """A normalised value."""
    message = par.ParameterValue()
    field = _FIELDS[type_of(value)]
    if field == "empty":
        message.empty.SetInParent()
    elif isinstance(value, list):
        getattr(message, field).values.extend(value)
    else:
        setattr(message, field, value)
    return message


def value_from_proto(name: str, message: par.ParameterValue) -> Value:
    """The value of the parameter ``name``.

    Raises:
        ParameterTypeMismatch: There is none in the message, say one of a type not known here.
    """
    field = message.WhichOneof("kind")
    if field is None:
        raise ParameterTypeMismatch(name, "comes with no value that is known here")
    if field == "empty":
        return []
    value: Any = getattr(message, field)
    return value if field.endswith("_value") else list(value.values)


def parameters_to_proto(values: Mapping[str, Value]) -> list[par.Parameter]:
    """Values by name."""
    return [par.Parameter(name=name, value=value_to_proto(value)) for name, value in values.items()]


def parameters_from_proto(messages: Iterable[par.Parameter]) -> dict[str, Value]:
    """Values by name. Raises as `value_from_proto`."""
    return {item.name: value_from_proto(item.name, item.value) for item in messages}


# -- declarations ----------------------------------------------------------------------------------


def _descriptor_to_proto(descriptor: Descriptor) -> par.ParameterDescriptor:
    limits = {"minimum": descriptor.minimum, "maximum": descriptor.maximum, "step": descriptor.step}
    return par.ParameterDescriptor(
        type=descriptor.type,
        description=descriptor.description,
        choices=[value_to_proto(choice) for choice in descriptor.choices],
        read_only=descriptor.read_only,
        **{name: value_to_proto(limit) for name, limit in limits.items() if limit is not None},
    )


def _descriptor_from_proto(name: str, message: par.ParameterDescriptor) -> Descriptor:
    def limit(field: str) -> Any:
        if not message.HasField(field):  # type: ignore[arg-type]
            return None
        value = value_from_proto(name, getattr(message, field))
        if not isinstance(value, int | float):
            raise ParameterTypeMismatch(name, f"its {field} is no number")
        return value

    choices: list[Any] = [value_from_proto(name, choice) for choice in message.choices]
    return Descriptor(
        message.type,
        message.description,
        limit("minimum"),
        limit("maximum"),
        limit("step"),
        tuple(choices),
        message.read_only,
    )


def declaration_to_proto(item: Declaration) -> par.ParameterDeclaration:
    """A declaration."""
    return par.ParameterDeclaration(
        parameter=par.Parameter(name=item.name, value=value_to_proto(item.value)),
        descriptor=_descriptor_to_proto(item.descriptor),
        origin=_ORIGINS[item.origin],
        standing=item.standing,
    )


def declaration_from_proto(message: par.ParameterDeclaration) -> Declaration:
    """A declaration, which is checked: it comes from elsewhere.

    Raises:
        ParameterError: It makes no sense.
    """
    name = message.parameter.name
    value = value_from_proto(name, message.parameter.value)
    descriptor = described(name, value, _descriptor_from_proto(name, message.descriptor))
    origin = _ORIGINS_BACK.get(message.origin, Origin.DEFAULT)
    return Declaration(name, descriptor, value, origin, message.standing)


def description_to_proto(name: str, entry: Entry) -> par.ParameterDescription:
    """All that the tree knows of a parameter."""
    message = par.ParameterDescription(
        parameter=par.Parameter(name=name, value=value_to_proto(entry.value)),
        origin=_ORIGINS[entry.origin],
        nodes=entry.owners,
        revision=entry.revision,
    )
    if entry.descriptor is not None:
        message.descriptor.CopyFrom(_descriptor_to_proto(entry.descriptor))
    return message


def description_from_proto(message: par.ParameterDescription) -> ParameterInfo:
    """The same, for tools."""
    name = message.parameter.name
    declared = message.HasField("descriptor")
    return ParameterInfo(
        name,
        value_from_proto(name, message.parameter.value),
        _ORIGINS_BACK.get(message.origin, Origin.SET),
        tuple(message.nodes),
        _descriptor_from_proto(name, message.descriptor) if declared else None,
        message.revision,
    )


# -- events and errors -----------------------------------------------------------------------------


def snapshot_event(values: Mapping[str, Value], revision: int) -> par.ParameterEvent:
    """All values, for a watcher."""
    snapshot = par.ParameterSnapshot(parameters=parameters_to_proto(values))
    return par.ParameterEvent(revision=revision, snapshot=snapshot)


def changes_event(changes: Iterable[Change], revision: int) -> par.ParameterEvent:
    """A group of changes, for a watcher."""
    messages = [
        par.ParameterChange(
            name=change.name,
            value=None if change.value is None else value_to_proto(change.value),
        )
        for change in changes
    ]
    return par.ParameterEvent(revision=revision, changes=par.ParameterChanges(changes=messages))


def problem_of(error: ParameterError | InvalidName) -> par.ParameterProblem:
    """An error, to be told."""
    reason = error.reason if isinstance(error, ParameterError) else f"name {error.reason}"
    return par.ParameterProblem(kind=type(error).__name__, name=error.name, reason=reason)


def error_from_proto(problem: par.ParameterProblem) -> ParameterError:
    """The error that was told."""
    return error_named(problem.kind, problem.name, problem.reason)
