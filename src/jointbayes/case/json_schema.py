"""JSON Schema of a case file, for editors: keys, types, choices and descriptions, as the tables of `spec` have them."""

from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from jointbayes.case.spec.whole import CaseSpec

_REF, _ANY_OF = "$ref", "anyOf"
_ASKED = ("required", "discriminator")
#: What a key may be besides what the table says, by the name of the function that turns it into that.
_ALSO: dict[str, JsonSchemaValue] = {
    "_channel_table": {"type": "string"},
    "_point_name": {"type": "integer"},
    "_or_measured": {"const": "measured"},
}


class _OfToml(GenerateJsonSchema):
    """Knows what validators let through besides, and that TOML has no null."""

    def function_before_schema(self, schema: Any) -> JsonSchemaValue:  # noqa: ANN401 (one of pydantic's tables)
        inner, name = self.generate_inner(schema["schema"]), getattr(schema["function"]["function"], "__name__", "")
        also = inner.get("items") if name in ("to_list", "<lambda>") else _ALSO.get(name)
        return inner if also is None else {_ANY_OF: [inner, also]}

    function_wrap_schema = function_before_schema

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])


def case_schema() -> dict[str, Any]:
    """The schema as JSON.

    Keys that a case needs are asked of a whole file alone: in one that `extends` another, and in the tables of a
    set-up, any may be left out.
    """
    whole = CaseSpec.model_json_schema(schema_generator=_OfToml)
    tables = {**whole.pop("$defs"), "Case": whole}
    relaxed = {f"{name}-changes": _without_required(table) for name, table in tables.items()}
    changes = relaxed["Case-changes"]
    for setup in ("SetupSpec-changes", "PlannedSetupSpec-changes"):
        for name in relaxed[setup]["properties"].keys() & changes["properties"].keys() - {"remove", "joined"}:
            relaxed[setup]["properties"][name] = changes["properties"][name]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Case file of jointbayes",
        **changes,
        "if": {"not": {_ANY_OF: [{"required": ["extends"]}, {"required": ["setups"]}]}},
        "then": {_REF: "#/$defs/Case"},
        "$defs": tables | relaxed,
    }


def _without_required(node: Any) -> Any:  # noqa: ANN401 (walks JSON)
    """The same for a table that is laid over another one: nothing is required."""
    if isinstance(node, list):
        return [_without_required(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    kept = {_ANY_OF if key == "oneOf" else key: value for key, value in node.items() if key not in _ASKED}
    return {key: f"{value}-changes" if key == _REF else _without_required(value) for key, value in kept.items()}
