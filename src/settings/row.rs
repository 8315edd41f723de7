//! What a row says about its setting, as help of the flag and as a row of the documentation.

use serde_json::Value;

use super::environment::PREFIX;

/// The texts of a setting.
pub(super) struct Row {
    /// Key in the file.
    pub key: &'static str,
    /// The flag without the dashes, where it is not the key: that of a list is in the singular.
    pub flag: Option<&'static str>,
    /// What the setting means.
    pub text: &'static str,
    /// What happens where an optional setting is unset; empty: nothing.
    pub unset: &'static str,
}

impl Row {
    /// The flag of the setting, without the dashes.
    pub(super) fn flag(&self) -> String {
        self.flag.map_or_else(|| self.key.replace('_', "-"), str::to_owned)
    }

    fn variable(&self) -> String {
        format!("{PREFIX}{}", self.key.to_uppercase())
    }

    /// The help of the flag: text, default and environment variable. `defaults` is the JSON of the default settings.
    pub(super) fn help(&self, defaults: &Value) -> String {
        let as_list = if defaults[self.key].is_array() { ", as [\"...\"]" } else { "" };
        let default = match self.default(defaults).as_str() {
            "" => String::new(),
            default => format!(" [default: {default}]"),
        };
        format!("{}{default} [env: {}{as_list}]", self.text, self.variable())
    }

    /// The row of the table in `docs/SETTINGS.md`.
    #[cfg(test)]
    pub(super) fn markdown(&self, defaults: &Value) -> String {
        let default = self.default(defaults);
        let default = if default.is_empty() { "none" } else { &default };
        format!("| `--{}` | `{}` | {default} | {} |\n", self.flag(), self.variable(), self.text)
    }

    fn default(&self, defaults: &Value) -> String {
        match &defaults[self.key] {
            Value::Null => self.unset.to_owned(),
            Value::String(text) => text.clone(),
            Value::Number(number) if self.key.ends_with("_bytes") => in_bytes(number.as_u64().unwrap_or_default()),
            Value::Array(items) if items.is_empty() => "none".to_owned(),
            Value::Array(items) => items.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(", "),
            other => other.to_string(),
        }
    }
}

/// A number of bytes in the largest unit that divides it.
fn in_bytes(bytes: u64) -> String {
    [(30, "GiB"), (20, "MiB")]
        .into_iter()
        .find(|(shift, _)| bytes > 0 && bytes.is_multiple_of(1 << shift))
        .map_or_else(|| bytes.to_string(), |(shift, unit)| format!("{} {unit}", bytes >> shift))
}
