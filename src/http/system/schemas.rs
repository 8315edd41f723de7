//! The schemas of the options of a stack, and the names of artifacts. One Rust type of options gives three schemas,
//! because generated clients need to distinguish them:
//!
//! | schema | used in | members |
//! |---|---|---|
//! | `StackOptions` | answers | all are present |
//! | `StackOptionsInput` | query parameters, the part `options` of a form | each is optional and has a default |
//! | `RerunOptions` | the body of a rerun | each may be omitted (unchanged) or null (its default) |
//!
//! None has a JSON Schema `default`: generated clients would send the defaults of the version that they were generated
//! from. The descriptions name the defaults.

use serde_json::{Map, Value, json};

use super::parameters;
use crate::contract::artifact::StackArtifact;

/// Adds the three schemas, derived from that of the Rust type, and lists the names of artifacts.
pub fn complete(document: &mut Value) {
    let Some(schemas) = document["components"]["schemas"].as_object_mut() else { return };
    let Some(Value::Object(properties)) = schemas.get("StackOptions").and_then(|made| made.get("properties")).cloned()
    else {
        return;
    };
    let object = |description: &str, properties: Map<String, Value>| {
        json!({
            "type": "object", "description": description, "additionalProperties": false, "properties": properties
        })
    };
    let each = |change: fn(&str, Value) -> Value| -> Map<String, Value> {
        properties.iter().map(|(name, schema)| (name.clone(), change(name, schema.clone()))).collect()
    };
    let description = "Options of a stack. An omitted option gets its default.";
    schemas.insert("StackOptionsInput".into(), object(description, each(input)));
    let description = "Options of a rerun. A member replaces that option of the stack; null resets the option to its default; \
                       an omitted option stays unchanged.";
    schemas.insert("RerunOptions".into(), object(description, each(rerun)));
    let names: Vec<&String> = properties.keys().collect();
    let shown = json!({
        "type": "object", "required": names, "properties": each(shown),
        "description": "Every option of a stack as it was used, with defaults filled in. The description of an option says \
            what null means."
    });
    schemas.insert("StackOptions".into(), shown);
    if let Some(name) = schemas.get_mut("ArtifactView").and_then(|view| view.pointer_mut("/properties/name")) {
        let names = StackArtifact::ALL.map(|artifact| format!("`{}`", artifact.name())).join(", ");
        name["description"] = format!("{names}, `lights/{{name}}`, `overlay-{{slice}}`, or of a reconstruction `points`, `cameras`, `model`, `poses` or `log`.").into();
    }
    let form = schemas.get_mut("StackForm").and_then(|form| form.pointer_mut("/properties/options"));
    if let Some(options) = form {
        *options = json!({
            "$ref": "#/components/schemas/StackOptionsInput", "description": "Options, JSON; every one has a default."
        });
    }
}

/// The schema of an option in answers.
fn shown(_: &str, mut schema: Value) -> Value {
    if let Some(schema) = schema.as_object_mut() {
        schema.remove("default");
    }
    schema
}

/// The schema of an option in requests: with its range, and its default in the description.
fn input(name: &str, mut schema: Value) -> Value {
    let Some(members) = schema.as_object_mut() else { return schema };
    let default = members.remove("default").filter(|default| !default.is_null());
    let described = members.get("description").and_then(Value::as_str);
    if let (Some(default), Some(described)) = (default, described) {
        let default = default.as_str().map_or_else(|| default.to_string(), str::to_owned);
        let described = format!("{described} Default: `{default}`.");
        members.insert("description".into(), described.into());
    }
    // in JSON a depth may also be a number, so its enumeration is a pattern
    let precise = parameters::precise(name).unwrap_or_default();
    for (member, value) in precise.as_object().into_iter().flatten() {
        // Schemathesis cannot generate "not" beside a binary part; the description says "odd"
        if !["type", "$ref", "enum", "format", "not"].contains(&member.as_str()) {
            members.insert(member.clone(), value.clone());
        }
    }
    schema
}

/// The schema of an option in a rerun: may also be null.
fn rerun(name: &str, schema: Value) -> Value {
    let mut schema = input(name, schema);
    if let Some(kind) = schema["type"].as_str().map(str::to_owned) {
        schema["type"] = json!([kind, "null"]);
    } else if let Some(members) = schema.as_object_mut()
        && let Some(reference) = members.remove("$ref")
    {
        members.insert("oneOf".into(), json!([{ "$ref": reference }, { "type": "null" }]));
    }
    schema
}
