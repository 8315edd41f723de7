//! The examples of problems in the OpenAPI document: one per code.

use serde_json::{Map, Value, json};

use crate::{
    contract::{Code, Fault},
    http::{
        problem::{PROBLEM_JSON, problem, status},
        problem_types::problem_type,
    },
};

/// Code, name and example of each code in the document.
pub struct Examples(Vec<(Code, String, Value)>);

/// The examples of all codes of the schema `Code`.
pub fn all(document: &Value) -> Examples {
    let names = document["components"]["schemas"]["Code"]["enum"].as_array();
    let codes = names.into_iter().flatten().filter_map(|name| serde_json::from_value::<Code>(name.clone()).ok());
    let example = |code: Code| {
        let example = problem(&Fault::new(code, problem_type(code).example), Some(link!("/v1/stacks")));
        (code, code.name(), json!({ "summary": example.title, "value": example }))
    };
    Examples(codes.map(example).collect())
}

impl Examples {
    /// The content of an answer with this status: a problem, with the examples of the codes that the description names.
    /// All answers share one schema, so that a generated client has one class of errors.
    pub fn content(&self, description: &str, answered: &str) -> Value {
        let is_named = |name: &str| description.contains(&format!("`{name}`"));
        let named = self.0.iter().filter(|(code, name, _)| status(*code).as_str() == answered && is_named(name));
        let examples: Map<String, Value> =
            named.map(|(_, name, _)| (name.clone(), json!({ "$ref": reference(name) }))).collect();
        json!({ PROBLEM_JSON: { "schema": { "$ref": "#/components/schemas/Problem" }, "examples": examples } })
    }

    /// The examples that some answer refers to. Codes that occur only in failed jobs are not among them.
    pub fn used_in(&self, document: &Value) -> Value {
        let text = document["paths"].to_string();
        let used = self.0.iter().filter(|(_, name, _)| text.contains(&format!("\"{}\"", reference(name))));
        used.map(|(_, name, example)| (name.clone(), example.clone())).collect::<Map<String, Value>>().into()
    }
}

fn reference(name: &str) -> String {
    format!("#/components/examples/{name}")
}
