//! The submission of a whole scan: one zip that becomes one stack per view.

use serde::Deserialize;
use utoipa::IntoParams;

use super::{Submission, stack::StackSubmission};
use crate::{
    contract::{Code, Name, Scan, options::StackOptions, profile::Profile},
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        extract::params,
        ingest::{fields::Fields, receivable::Receivable},
        profiles, scans,
    },
};
use pinstack_science::archive::scan::{Angle, AxisRule, ScanRules, ScanView};

/// A zip with all views of a scan.
pub struct ScanSubmission {
    /// The scan.
    pub scan: Scan,
    /// Only the grouping is requested.
    pub dry_run: bool,
    /// How names are read.
    pub rules: ScanRules,
    profile: Profile,
    options: StackOptions,
    /// The revision that the request names; `options` has the one that is used.
    asked_revision: Option<u32>,
}

/// The parameters that belong to the archive and not to its stacks, but for [`NameRules`].
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
struct ArchiveParameters {
    rig: Option<Name>,
    lens: Option<Name>,
    dry_run: bool,
}

/// The parameters that say how names are read.
#[derive(Debug, Deserialize, Default, IntoParams)]
#[serde(default, deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct NameRules {
    /// The angle that a number after `x` in a name is, as in `x=6`; default `tilt`.
    #[param(inline)]
    pub x: Option<Angle>,
    /// Degrees per unit of that number; default: 1 after `=`, unknown otherwise (`_x_00190_`: steps of a motor).
    pub x_degrees_per_unit: Option<f64>,
    /// The number at 0 degrees; default 0.
    pub x_zero: Option<f64>,
    /// The same for a number after `y`; default `pan`.
    #[param(inline)]
    pub y: Option<Angle>,
    /// Degrees per unit of that number.
    pub y_degrees_per_unit: Option<f64>,
    /// The number at 0 degrees; default 0.
    pub y_zero: Option<f64>,
}

/// The names of [`NameRules`].
pub const NAME_RULES: [&str; 6] = ["x", "x_degrees_per_unit", "x_zero", "y", "y_degrees_per_unit", "y_zero"];
/// The other parameters of the archive.
const PARAMETERS: [&str; 3] = ["rig", "lens", "dry_run"];

impl NameRules {
    /// What names mean. If only one of the two axes is given, the other is the other angle.
    ///
    /// # Errors
    /// `invalid_request` when both axes are the same angle, or a number is out of range.
    pub fn rules(&self) -> ApiResult<ScanRules> {
        let other = |angle| match angle {
            Angle::Pan => Angle::Tilt,
            Angle::Tilt => Angle::Pan,
        };
        let x = self.x.or(self.y.map(other)).unwrap_or(Angle::Tilt);
        let y = self.y.unwrap_or(other(x));
        if x == y {
            let detail = "x and y are the same angle; one must be pan, the other tilt";
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        let (x_zero, y_zero) = (self.x_zero.unwrap_or(0.0), self.y_zero.unwrap_or(0.0));
        let is_valid = |number: f64| number.is_finite() && number.abs() <= MAX_UNITS;
        let numbers = [
            ("x_degrees_per_unit", self.x_degrees_per_unit.unwrap_or(1.0)),
            ("x_zero", x_zero),
            ("y_degrees_per_unit", self.y_degrees_per_unit.unwrap_or(1.0)),
            ("y_zero", y_zero),
        ];
        if let Some((name, _)) = numbers.into_iter().find(|(_, number)| !is_valid(*number)) {
            let detail = format!("{name} must be a number from -{MAX_UNITS} to {MAX_UNITS}");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        Ok(ScanRules {
            x: AxisRule { angle: x, degrees_per_unit: self.x_degrees_per_unit, zero: x_zero },
            y: AxisRule { angle: y, degrees_per_unit: self.y_degrees_per_unit, zero: y_zero },
        })
    }
}

/// Largest number of the rules for axes.
const MAX_UNITS: f64 = 1e6;

impl Receivable for ScanSubmission {
    type Target = Name;

    /// # Errors
    /// `scan_not_found`; `scan_mismatch` for another rig or lens than that of the scan; `profile_not_found`;
    /// `invalid_request` for an invalid option, or one that belongs to a single view.
    async fn read(app: &App, caller: &Caller, scan: &Name, fields: &Fields) -> ApiResult<Self> {
        let named = |names: &'static [&str]| move |(name, _): &(String, String)| names.contains(&name.as_str());
        let (rules, rest): (Vec<_>, Vec<_>) = fields.pairs.iter().cloned().partition(named(&NAME_RULES));
        let (archive, options): (Vec<_>, Vec<_>) = rest.into_iter().partition(named(&PARAMETERS));
        let rules = params::typed::<NameRules>(&rules)?.rules()?;
        let ArchiveParameters { rig, lens, dry_run } = params::typed(&archive)?;
        let options = Fields { pairs: options, options: fields.options.clone() };
        let mut options: StackOptions = options.options()?;
        options.check()?;
        refuse_options_of_one_view(&options, scan)?;
        let scan = scans::find(app, caller, scan).await?;
        let (rig, lens) = (rig.unwrap_or(scan.input.rig.clone()), lens.unwrap_or(scan.input.lens.clone()));
        scans::require_joinable(app, caller, &scan.name, &rig, &lens).await?;
        let profile = profiles::find(app, &rig, &lens, options.profile_revision).await?;
        // every view is fused with this revision, also when the profile changes while the zip arrives
        let asked_revision = options.profile_revision.replace(profile.revision);
        options.scan = Some(scan.name.clone());
        Ok(Self { scan, dry_run, rules, profile, options, asked_revision })
    }

    /// The views are written beside the zip, before the zip is removed.
    fn disk_need(&self, announced: u64) -> u64 {
        if self.dry_run { 0 } else { announced }
    }

    fn max_bytes(app: &App) -> u64 {
        app.policy.max_scan_bytes
    }
}

fn refuse_options_of_one_view(options: &StackOptions, scan: &Name) -> ApiResult<()> {
    let given = [
        ("label", options.label.is_some()),
        ("pan_deg", options.pan_deg.is_some()),
        ("tilt_deg", options.tilt_deg.is_some()),
        ("scan", options.scan.as_ref().is_some_and(|named| named != scan)),
    ];
    let Some((name, _)) = given.into_iter().find(|(_, is_given)| *is_given) else { return Ok(()) };
    let detail = format!(
        "'{name}' belongs to one view and cannot be given for a whole scan: label and angles come from the names in the \
         zip or from its manifest.json, the scan from the URL"
    );
    Err(ApiError::new(Code::InvalidRequest, detail))
}

impl ScanSubmission {
    /// The submission of one view.
    ///
    /// # Errors
    /// `invalid_request` for a label or angles outside their ranges, or a crop that leaves the canvas.
    pub fn view(&self, view: &ScanView) -> ApiResult<Submission> {
        let options = StackOptions {
            label: view.label.clone(),
            pan_deg: view.pan_deg,
            tilt_deg: view.tilt_deg,
            ..self.options.clone()
        };
        Ok(Submission::Stack(Box::new(StackSubmission::new(self.profile.clone(), options, None)?)))
    }

    /// Number of slices per light that the profile needs.
    pub fn slice_count(&self) -> usize {
        self.profile.slice_count as usize
    }

    /// What the client asked for. Part of the fingerprint that tells whether a repeated `Idempotency-Key` comes with
    /// the same request. A request that names no revision stays the same when the profile has a new one.
    pub fn fingerprint_input(&self) -> serde_json::Value {
        let options = StackOptions { profile_revision: self.asked_revision, ..self.options.clone() };
        serde_json::json!({ "scan": self.scan.name, "options": options, "rules": self.rules })
    }
}
