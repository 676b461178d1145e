"""JSON Schema of a case file, for editors: keys, types, choices and descriptions, as the tables of `spec` have them."""

from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from jointbayes.case.spec.fields import POINT_LABEL
from jointbayes.case.spec.whole import CaseSpec

_REF, _ANY_OF = "$ref", "anyOf"
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

    def function_after_schema(self, schema: Any) -> JsonSchemaValue:  # noqa: ANN401 (one of pydantic's tables)
        inner, name = self.generate_inner(schema["schema"]), getattr(schema["function"]["function"], "__name__", "")
        return {**inner, "pattern": f"^{POINT_LABEL}:(x|y|z|rx|ry|rz)$"} if name == "_label" else inner

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])


def case_schema() -> dict[str, Any]:
    """The schema as JSON.

    Keys that a case needs are asked of a whole file alone: in one that `extends` another, and in the tables of a
    test, any may be left out.
    """
    whole = CaseSpec.model_json_schema(schema_generator=_OfToml)
    given = {**whole.pop("$defs"), "Case": whole}
    tables = {name: _prepared(table, given) for name, table in given.items()}
    relaxed = {f"{name}-changes": _prepared(table, given, "-changes") for name, table in given.items()}
    tables["Case"]["if"], tables["Case"]["then"] = {"not": {"required": ["joints"]}}, {"required": ["joint"]}
    changes = relaxed["Case-changes"]
    test = relaxed["TestSpec-changes"]["properties"]
    for name in test.keys() & changes["properties"].keys() - {"remove", "joined"}:
        test[name] = changes["properties"][name]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Case file of jointbayes",
        "if": {"not": {_ANY_OF: [{"required": ["extends"]}, {"required": ["tests"]}]}},
        "then": {_REF: "#/$defs/Case"},
        "else": {_REF: "#/$defs/Case-changes"},
        _ANY_OF: [{_REF: "#/$defs/Case-changes"}, {}],  # of which editors complete keys
        "$defs": tables | relaxed,
    }


def _prepared(node: Any, given: dict[str, Any], suffix: str = "") -> Any:  # noqa: ANN401 (walks JSON)
    """The same with if and then for tables of several kinds; nothing is required of one that is laid over another.

    So a fault is one of the kind that is meant, and not that no kind fits.
    """
    if isinstance(node, list):
        return [_prepared(entry, given, suffix) for entry in node]
    if not isinstance(node, dict):
        return node
    items = ((key, value) for key, value in node.items() if key != "required" or not suffix)
    kept: dict[str, Any] = {
        key: f"{value}{suffix}" if key == _REF else _prepared(value, given, suffix) for key, value in items
    }
    if "discriminator" not in node:
        return kept
    options, (refs, kind) = kept.pop("oneOf"), kept.pop("discriminator").values()
    free = [ref for ref in refs.values() if suffix or kind not in given[ref.rpartition("/")[2]].get("required", ())]
    rules: list[Any] = [{_ANY_OF: [*options, {}]}]  # of which editors complete keys
    for text, ref in refs.items():
        meant = {"properties": {kind: {"const": text}}, "required": [kind] if suffix or ref not in free else []}
        rules.append({"if": meant, "then": {_REF: f"{ref}{suffix}"}})
    if suffix:
        rules.append({"if": {"not": {"required": [kind]}}, "then": {_ANY_OF: options}})
    known = {"properties": {kind: {"enum": list(refs)}}, "required": [] if free else [kind]}
    return kept | known | {"allOf": rules}
