//! The views of a scan, what belongs to none, and the rules for names.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{archive::members::Member, types::view::ViewAngles};

/// One of the two angles of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Angle {
    /// About the axis of the turntable.
    Pan,
    /// Above the plane of the turntable.
    Tilt,
}

/// What the number after `x` or `y` in a name means: `angle = (number - zero) * degrees_per_unit`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AxisRule {
    /// The angle that the axis turns.
    pub angle: Angle,
    /// Degrees per unit of the number, positive or negative. Null: 1 after `=` (`x=6`), unknown otherwise
    /// (`_x_00190_`), because such numbers are steps of a motor.
    #[serde(default)]
    pub degrees_per_unit: Option<f64>,
    /// The number at 0 degrees.
    #[serde(default)]
    pub zero: f64,
}

/// What names mean. The default needs no thought: `x` is the tilt, `y` the pan, and steps of motors are no angles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default)]
pub struct ScanRules {
    /// The number after `x`.
    pub x: AxisRule,
    /// The number after `y`.
    pub y: AxisRule,
}

impl Default for ScanRules {
    fn default() -> Self {
        let axis = |angle| AxisRule { angle, degrees_per_unit: None, zero: 0.0 };
        Self { x: axis(Angle::Tilt), y: axis(Angle::Pan) }
    }
}

/// One view of a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScanView {
    /// The name of the view: its folder, the start of its file names, or the label in the manifest. Null for a view
    /// that only its angles name.
    pub label: Option<String>,
    /// Pan, degrees; null when names do not say it.
    pub pan_deg: Option<f64>,
    /// Tilt, degrees; null when names do not say it.
    pub tilt_deg: Option<f64>,
    /// The folder of the front-light slices in the zip; empty for the root.
    pub folder: String,
    /// Names of the front-light slices in the zip, in order.
    pub front: Vec<String>,
    /// Names of the back-light slices in the zip, in order; empty without a back light.
    pub back: Vec<String>,
    /// Upper bound of the size of the zip of this view, bytes.
    pub bytes: u64,
}

impl ScanView {
    /// Both angles, when both are known.
    pub fn angles(&self) -> Option<ViewAngles> {
        Some(ViewAngles { pan_deg: self.pan_deg?, tilt_deg: self.tilt_deg? })
    }
}

/// The members of the zip of one view.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ViewFiles {
    /// For each slice its name in the zip of the view, and its position in the directory of the scan.
    pub members: Vec<(String, usize)>,
    /// `manifest.json`, when the order of the slices is not that of their names.
    pub manifest: Option<Vec<u8>>,
}

/// A file that belongs to no view.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = IgnoredFile)]
pub struct Ignored {
    /// Its name in the zip.
    pub name: String,
    /// Why: one sentence without a full stop.
    pub reason: String,
}

/// The members of one view.
#[derive(Debug, Clone)]
pub(super) struct Group {
    /// The name of the view; `None` when its angles name it.
    pub label: Option<String>,
    /// Pan, degrees.
    pub pan_deg: Option<f64>,
    /// Tilt, degrees.
    pub tilt_deg: Option<f64>,
    /// The folders and the part of the file names that name the view, or the label in a manifest. Empty for the root.
    pub name: String,
    /// Front-light slices, in order.
    pub front: Vec<Member>,
    /// Back-light slices, in order.
    pub back: Vec<Member>,
}

impl Group {
    /// Both angles, when both are known.
    pub(super) fn angles(&self) -> Option<ViewAngles> {
        Some(ViewAngles { pan_deg: self.pan_deg?, tilt_deg: self.tilt_deg? })
    }

    /// What sentences call the view.
    pub(super) fn shown(&self) -> &str {
        if self.name.is_empty() { "the root of the zip" } else { &self.name }
    }
}
