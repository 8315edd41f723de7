//! What an upload is for. A stack and a calibration each implement [`Order`]; everything else about an upload is
//! the same for both.

use crate::{
    contract::{
        Code, Fault, JobKind, Name,
        request::{JobRequest, Upload},
    },
    http::{
        extract::{json, params},
        problem::{ApiError, ApiResult},
        state::App,
    },
};
use pinstack_science::types::{Warning, stack_layout::StackLayout};
use serde::de::DeserializeOwned;

/// The texts that say what is wanted: query parameters, parts of the path, and parts of a form.
#[derive(Debug, Clone, Default)]
pub struct Fields {
    /// Name and value; each name once.
    pub pairs: Vec<(String, String)>,
    /// The `options` part of a form: JSON.
    pub options: Option<Vec<u8>>,
}

impl Fields {
    /// The value of a field.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.pairs.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// Adds a field of a form.
    ///
    /// # Errors
    /// `invalid_request` when the URL has it too: one of the two would be passed over in silence.
    pub fn add(&mut self, name: &str, value: String) -> ApiResult<()> {
        if self.get(name).is_some() {
            let name: String = name.chars().take(80).collect();
            let detail = format!("'{name}' is given twice, in the URL and as a part of the form; give it once");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        self.set(name, value);
        Ok(())
    }

    /// Sets a field, over what the URL said.
    pub fn set(&mut self, name: &str, value: String) {
        self.pairs.retain(|(n, _)| n != name);
        self.pairs.push((name.to_owned(), value));
    }

    /// The options: parameters, or the JSON of the `options` part.
    ///
    /// # Errors
    /// `invalid_request` that names the option.
    pub fn options<T: DeserializeOwned>(&self) -> ApiResult<T> {
        let parameters: Vec<(String, String)> =
            self.pairs.iter().filter(|(name, _)| name != "rig" && name != "lens").cloned().collect();
        let Some(document) = &self.options else { return params::typed(&parameters) };
        if let Some((name, _)) = parameters.first() {
            let detail = format!("'{name}' is given beside the options part; give the options in one way");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        json::parse(document, Code::InvalidRequest).map_err(|fault| {
            let detail = format!("options: {}", fault.detail);
            Fault { detail, ..fault }.into()
        })
    }
}

/// What an upload is for, with all that must hold before its bytes are read.
pub trait Order: Sized + Send + 'static {
    /// Stacks or calibrations.
    const KIND: JobKind;

    /// True when the fields say which profile it is about: then it can be checked.
    fn is_addressed(fields: &Fields) -> bool;

    /// Checks names and options, and that the profile exists.
    ///
    /// # Errors
    /// `invalid_request`, `profile_not_found`.
    fn read(app: &App, fields: &Fields) -> impl Future<Output = ApiResult<Self>> + Send;

    /// The rig and the lens.
    fn key(&self) -> (&Name, &Name);

    /// Bytes that the job may write beyond its upload, as far as can be known before the upload arrives.
    fn disk_need(&self) -> u64;

    /// What the client asked for, for the fingerprint of an `Idempotency-Key`.
    fn asked(&self) -> serde_json::Value;

    /// Checks what is in the zip against what is wanted.
    ///
    /// # Errors
    /// `size_mismatch`, `slice_count_mismatch`, ... with both numbers.
    fn check(&self, layout: &StackLayout) -> Result<Vec<Warning>, Fault>;

    /// The request that the row keeps.
    fn request(&self, upload: Upload, layout: StackLayout) -> JobRequest;
}
