//! A complete profile as a file that another server can import.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use utoipa::ToSchema;

use crate::{
    contract::{
        Code, Fault,
        profile::{Profile, ProfileOrigin},
    },
    http::extract::json,
    store::{
        ProfileDraft,
        digest::{hex, optics_digest, profile_digest},
    },
};
use pinstack_science::types::{Warning, error::ErrorLocation};

/// The member `format` of every such file.
const FORMAT: &str = "pinstack-profile";

/// The version that is written and read.
const VERSION: u64 = 1;

/// An exported profile: all that the server knows about one revision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProfileFile {
    /// Always `pinstack-profile`.
    pub format: String,
    /// Version of the file format: 1.
    pub version: u64,
    /// SHA-256 (hex) of all other members, independent of whitespace and order.
    pub checksum: String,
    /// The profile.
    #[serde(flatten)]
    pub profile: Profile,
}

impl ProfileFile {
    /// Makes the file of a profile.
    ///
    /// # Errors
    /// When the profile cannot be serialised.
    pub fn of(profile: Profile) -> serde_json::Result<Self> {
        let mut file = Self { format: FORMAT.into(), version: VERSION, checksum: String::new(), profile };
        file.checksum = checksum(&serde_json::to_value(&file)?);
        Ok(file)
    }

    /// Reads a file and checks that it is unchanged.
    ///
    /// # Errors
    /// `invalid_request` for a file that is not JSON; `invalid_profile` for another format or version, for a file that
    /// was changed after its export, and for inconsistent or impossible values.
    pub fn read(bytes: &[u8]) -> Result<Self, Fault> {
        let value: Value = json::parse(bytes, Code::InvalidProfile)?;
        if value["format"] != FORMAT {
            return Err(at(
                "/format",
                format!(
                    "this is not an exported profile: its 'format' is {}, not '{FORMAT}'; send a file from .../export, or PUT \
                     homographies from elsewhere",
                    shown(&value["format"])
                ),
            ));
        }
        if value["version"].as_u64() != Some(VERSION) {
            let version = shown(&value["version"]);
            return Err(at(
                "/version",
                format!(
                    "the file is of version {version}; this server reads version {VERSION}: export it again, or update this server"
                ),
            ));
        }
        let file: Self = json::parse(bytes, Code::InvalidProfile)?;
        let digest = profile_digest(&file.profile.input);
        if digest != file.profile.digest {
            return Err(at(
                "/digest",
                "the file was changed after it was exported: its homographies, gains, size or reference slice do not match its digest; \
                 export it again, or PUT changed numbers as a profile of your own",
            ));
        }
        // files of older versions do not have this digest
        let optics = &file.profile.optics_digest;
        if !optics.is_empty() && *optics != optics_digest(&file.profile.input) {
            return Err(at(
                "/optics_digest",
                "the file was changed after it was exported: its camera data does not match its optics_digest; \
                 export it again, or PUT changed numbers as a profile of your own",
            ));
        }
        if checksum(&value) != file.checksum {
            return Err(at(
                "/checksum",
                "the file was changed after it was exported: a value other than the homographies and gains differs; export it \
                 again, or PUT changed numbers as a profile of your own",
            ));
        }
        file.profile.input.check()?;
        file.check_slices()?;
        file.check_warnings()?;
        Ok(file)
    }

    /// The revision to store here.
    pub fn draft(self) -> ProfileDraft {
        let Profile { rig, lens, revision, digest, created_at, calibration_id, .. } = self.profile;
        ProfileDraft {
            input: self.profile.input,
            source: self.profile.source,
            // the calibration is a job of the other server
            calibration_id: None,
            model: self.profile.model,
            slices: self.profile.slices,
            origin: Some(ProfileOrigin { rig, lens, revision, digest, created_at, calibration_id }),
            warnings: self.profile.warnings,
        }
    }

    /// Checks the size of the warnings, which are shown in lists: at most what this service writes.
    fn check_warnings(&self) -> Result<(), Fault> {
        let warnings = &self.profile.warnings;
        let is_long = |w: &Warning| w.code.as_str().len() > 64 || w.detail.chars().count() > 2000;
        if warnings.len() > 100 || warnings.iter().any(is_long) {
            return Err(at(
                "/warnings",
                "the file has more than 100 warnings, or a warning of more than 2,000 characters",
            ));
        }
        Ok(())
    }

    /// Checks that the list of slices agrees with the lists of numbers: results are computed from one and shown from
    /// the other.
    fn check_slices(&self) -> Result<(), Fault> {
        let Profile { input, slices, .. } = &self.profile;
        let count = input.homographies.len();
        if slices.len() != count || self.profile.slice_count as usize != count {
            let detail = format!("the file has {count} homographies but {} slices", slices.len());
            return Err(at("/slices", detail));
        }
        for (i, (slice, homography)) in slices.iter().zip(&input.homographies).enumerate() {
            if slice.index as usize != i || slice.homography != *homography || slice.gain != input.gain(i) {
                let detail = format!("slice {i} does not agree with the homographies and gains of the file");
                return Err(at(&format!("/slices/{i}"), detail));
            }
        }
        Ok(())
    }
}

fn at(pointer: &str, detail: impl Into<String>) -> Fault {
    let detail = detail.into();
    let place = ErrorLocation { detail: detail.clone(), pointer: Some(pointer.to_owned()), ..ErrorLocation::default() };
    Fault::new(Code::InvalidProfile, detail).at(place)
}

/// A JSON value for an error message, at most 80 characters.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => "missing".into(),
        Value::String(text) => format!("'{}'", text.chars().take(80).collect::<String>()),
        other => other.to_string().chars().take(80).collect(),
    }
}

/// SHA-256 (hex) of all members except `checksum`. Whitespace, the order of members and the notation of numbers do not
/// matter, because programs that copy JSON change them.
fn checksum(file: &Value) -> String {
    let mut hash = Sha256::new();
    hash.update(b"pinstack profile file 1\0");
    match file {
        Value::Object(members) => hash_members(&mut hash, members.iter().filter(|(name, _)| *name != "checksum")),
        other => hash_value(&mut hash, other),
    }
    hex(&hash.finalize())
}

fn hash_value(hash: &mut Sha256, value: &Value) {
    match value {
        Value::Null => hash.update(b"n"),
        Value::Bool(yes) => hash.update([b'b', u8::from(*yes)]),
        Value::Number(number) => {
            hash.update(b"d");
            // adding zero turns -0.0 into 0.0, which is the same number
            hash.update((number.as_f64().unwrap_or(f64::NAN) + 0.0).to_le_bytes());
        }
        Value::String(text) => hash_text(hash, text),
        Value::Array(items) => {
            hash.update(b"a");
            hash.update((items.len() as u64).to_le_bytes());
            items.iter().for_each(|item| hash_value(hash, item));
        }
        Value::Object(members) => hash_members(hash, members.iter()),
    }
}

fn hash_members<'a>(hash: &mut Sha256, members: impl Iterator<Item = (&'a String, &'a Value)>) {
    let mut members: Vec<_> = members.collect();
    members.sort_by_key(|(name, _)| *name);
    hash.update(b"o");
    hash.update((members.len() as u64).to_le_bytes());
    for (name, value) in members {
        hash_text(hash, name);
        hash_value(hash, value);
    }
}

fn hash_text(hash: &mut Sha256, text: &str) {
    hash.update(b"s");
    hash.update((text.len() as u64).to_le_bytes());
    hash.update(text.as_bytes());
}
