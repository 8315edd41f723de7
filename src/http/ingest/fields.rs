//! The texts that describe a submission, wherever they were sent: query parameters, path segments, parts of a form,
//! or the metadata of a resumable upload.

use axum::http::Uri;
use serde::de::DeserializeOwned;

use crate::{
    contract::{Code, Fault},
    http::{
        ApiError, ApiResult,
        extract::{json, params},
    },
};

/// Named texts and, of a form, a JSON document of options.
#[derive(Debug, Clone, Default)]
pub struct Fields {
    /// Name and value; each name once.
    pub pairs: Vec<(String, String)>,
    /// The `options` part of a form: JSON.
    pub options: Option<Vec<u8>>,
}

impl Fields {
    /// The query parameters of a request.
    ///
    /// # Errors
    /// `invalid_request` for a query string that cannot be read or repeats a parameter.
    pub fn of_query(uri: &Uri) -> ApiResult<Self> {
        Ok(Self { pairs: params::pairs(uri)?, options: None })
    }

    /// The value of a field.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.pairs.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// True when rig and lens are known, so that the profile can be looked up.
    pub fn name_profile(&self) -> bool {
        self.get("rig").is_some() && self.get("lens").is_some()
    }

    /// Adds a field of a form.
    ///
    /// # Errors
    /// `invalid_request` when the URL has it too: one of the two values would be ignored without a word.
    pub fn add(&mut self, name: &str, value: String) -> ApiResult<()> {
        if self.get(name).is_some() {
            let name: String = name.chars().take(80).collect();
            let detail = format!("'{name}' is given twice, in the URL and as a part of the form; give it once");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        self.set(name, value);
        Ok(())
    }

    /// Sets a field and replaces an earlier value.
    pub fn set(&mut self, name: &str, value: String) {
        self.pairs.retain(|(n, _)| n != name);
        self.pairs.push((name.to_owned(), value));
    }

    /// The options: from the query parameters, or from the JSON of the `options` part.
    ///
    /// # Errors
    /// `invalid_request` that names the option.
    pub fn options<T: DeserializeOwned>(&self) -> ApiResult<T> {
        let parameters: Vec<(String, String)> =
            self.pairs.iter().filter(|(name, _)| name != "rig" && name != "lens").cloned().collect();
        let Some(document) = &self.options else { return params::typed(&parameters) };
        if let Some((name, _)) = parameters.first() {
            let detail = format!(
                "'{name}' is given in addition to the part 'options'; send all options as parameters, or all in that \
                 part"
            );
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        json::parse(document, Code::InvalidRequest).map_err(|fault| {
            let detail = format!("options: {}", fault.detail);
            Fault { detail, ..fault }.into()
        })
    }
}
