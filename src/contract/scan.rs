//! Scans: named sets of stacks, one per view of an object.

use std::collections::BTreeMap;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::types::error::ErrorLocation;

use super::{Fault, Name};

/// Largest number of entries of `metadata`.
const MAX_ENTRIES: usize = 100;
/// Longest key of `metadata`, in characters.
const MAX_KEY: usize = 100;
/// Longest text, in characters.
const MAX_TEXT: usize = 4000;
/// Largest number of views that a scan may expect.
pub const MAX_VIEWS: u32 = 10_000;
/// Largest distance from the camera to the centre of the turntable, mm.
const MAX_RADIUS_MM: f64 = 100_000.0;

/// Body of `PUT /v1/scans/{scan}`. Members that `GET` adds are ignored, so its response can be sent unchanged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanInput {
    /// Rig of all its stacks.
    pub rig: Name,
    /// Lens of all its stacks.
    pub lens: Name,
    /// How many views the scan will have.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 10_000)]
    pub expected_views: Option<u32>,
    /// The specimen: a catalogue number, for example.
    #[serde(default)]
    #[schema(max_length = 4000)]
    pub specimen: Option<String>,
    /// Its taxon.
    #[serde(default)]
    #[schema(max_length = 4000)]
    pub taxon: Option<String>,
    /// Who took the photographs.
    #[serde(default)]
    #[schema(max_length = 4000)]
    pub operator: Option<String>,
    /// Free text.
    #[serde(default)]
    #[schema(max_length = 4000)]
    pub note: Option<String>,
    /// Distance from the centre of projection to the point where the axes of pan and tilt meet, mm. With it, the camera
    /// positions in a bundle are in mm.
    #[serde(default)]
    #[schema(exclusive_minimum = 0, maximum = 100_000)]
    pub radius_mm: Option<f64>,
    /// Which way pan turns, seen from above.
    #[serde(default)]
    pub pan_direction: PanDirection,
    /// When the scan is reconstructed. `auto` needs `expected_views`.
    #[serde(default)]
    pub reconstruct: Reconstruct,
    /// Further entries of your own: at most 100, keys of at most 100 characters, values of at most 4000.
    #[serde(default)]
    pub metadata: BTreeMap<String, String>,
}

/// The direction of growing pan.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PanDirection {
    /// With growing pan the camera moves counter-clockwise around the object, seen from above: the table turns
    /// clockwise.
    #[default]
    Counterclockwise,
    /// With growing pan the camera moves clockwise around the object: the table turns counter-clockwise.
    Clockwise,
}

/// When a scan is reconstructed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reconstruct {
    /// When a client asks for it.
    #[default]
    OnRequest,
    /// By itself as well: when as many views as are expected have a result and none is waiting, running or failed, and
    /// again after views were replaced, added or removed.
    Auto,
}

/// A stored scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Scan {
    /// Name.
    pub name: Name,
    /// What was sent.
    #[serde(flatten)]
    pub input: ScanInput,
    /// Incremented by each `PUT`; also its `ETag`.
    pub version: u32,
    /// When it was created.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When it was last written.
    #[schema(value_type = String, format = DateTime)]
    pub updated_at: Timestamp,
}

impl ScanInput {
    /// Checks what the types alone do not.
    ///
    /// # Errors
    /// [`Code::InvalidRequest`](super::Code::InvalidRequest) with a location for each member that breaks a rule.
    pub fn check(&self) -> Result<(), Fault> {
        let mut locations = Vec::new();
        let mut violated = |pointer: &str, rule: String| {
            let detail = format!("{pointer} {rule}");
            locations.push(ErrorLocation { detail, pointer: Some(format!("/{pointer}")), ..ErrorLocation::default() });
        };
        if self.expected_views.is_some_and(|views| !(1..=MAX_VIEWS).contains(&views)) {
            violated("expected_views", format!("must be 1 to {MAX_VIEWS}"));
        }
        if self.reconstruct == Reconstruct::Auto && self.expected_views.is_none() {
            violated("expected_views", "must be given with reconstruct=auto, which waits for so many views".to_owned());
        }
        if self.radius_mm.is_some_and(|radius| !(radius > 0.0 && radius <= MAX_RADIUS_MM)) {
            violated("radius_mm", format!("must be above 0 and at most {MAX_RADIUS_MM}"));
        }
        let texts =
            [("specimen", &self.specimen), ("taxon", &self.taxon), ("operator", &self.operator), ("note", &self.note)];
        for (name, text) in texts {
            if text.as_ref().is_some_and(|text| text.chars().count() > MAX_TEXT) {
                violated(name, format!("must have at most {MAX_TEXT} characters"));
            }
        }
        if self.metadata.len() > MAX_ENTRIES {
            violated("metadata", format!("must have at most {MAX_ENTRIES} entries"));
        }
        let is_too_long = |(key, value): &(&String, &String)| {
            key.chars().count() > MAX_KEY || value.chars().count() > MAX_TEXT || key.is_empty()
        };
        if let Some((key, _)) = self.metadata.iter().find(is_too_long) {
            let key: String = key.chars().take(MAX_KEY).collect();
            let rule = format!("has the entry '{key}'; keys need 1 to {MAX_KEY} characters, values at most {MAX_TEXT}");
            violated("metadata", rule);
        }
        Fault::refuse(locations)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input() -> ScanInput {
        serde_json::from_str(r#"{"rig": "r", "lens": "l"}"#).expect("the rest has defaults")
    }

    #[test]
    fn every_violation_is_located() {
        let wrong = ScanInput {
            expected_views: Some(0),
            radius_mm: Some(f64::NAN),
            note: Some("x".repeat(4001)),
            metadata: BTreeMap::from([(String::new(), String::new())]),
            ..input()
        };
        let endless = ScanInput { reconstruct: Reconstruct::Auto, ..input() };
        assert!(endless.check().expect_err("how many views?").detail.contains("expected_views must be given"));
        let fault = wrong.check().expect_err("four rules are broken");
        let pointers: Vec<_> = fault.locations.iter().filter_map(|location| location.pointer.as_deref()).collect();
        assert_eq!(pointers, ["/expected_views", "/radius_mm", "/note", "/metadata"]);
        assert_eq!(input().check(), Ok(()));
    }

    #[test]
    fn what_get_returns_can_be_put_again() {
        let time = Timestamp::UNIX_EPOCH;
        let scan = Scan {
            name: Name::new("bee").expect("a name"),
            input: ScanInput { taxon: Some("Apis mellifera".into()), ..input() },
            version: 3,
            created_at: time,
            updated_at: time,
        };
        let text = serde_json::to_string(&scan).expect("JSON");
        assert_eq!(serde_json::from_str::<ScanInput>(&text).expect("readable"), scan.input);
    }
}
