//! What is conspicuous about a reconstruction, in words.

use super::turntable::{OddStep, Placed, odd_steps};
use crate::contract::reconstruction::{ReconstructedView, ReconstructionFinding, ReconstructionRequest};
use pinstack_science::{
    photogrammetry::poses::PoseReport,
    types::{Warning, WarningCode},
};

/// Features of a view below which they are few.
const FEW_FEATURES: u32 = 300;
/// Fewest views to which a wobble is fitted.
const WOBBLE_VIEWS: usize = 8;
/// Amplitude of a wobble that is told, degrees.
const WOBBLE_DEG: f64 = 0.5;
/// Share of the variance of the tilt that a wobble must explain.
const WOBBLE_SHARE: f64 = 0.7;

/// What findings are made from.
pub(super) struct Evidence<'a> {
    pub request: &'a ReconstructionRequest,
    pub views: &'a [ReconstructedView],
    /// Numbers of views of the parts that do not connect, the largest first.
    pub parts: &'a [u64],
    pub placed: &'a [Placed],
    pub poses: Option<&'a PoseReport>,
}

impl Evidence<'_> {
    /// The findings, the most serious first.
    pub(super) fn findings(&self) -> Vec<ReconstructionFinding> {
        let mut all = Vec::new();
        all.extend(self.no_model());
        all.extend(self.several_parts());
        all.extend(self.views.iter().filter(|view| !view.registered).map(|view| self.not_registered(view)));
        all.extend(odd_steps(self.placed).into_iter().map(odd_step));
        all.extend(self.poses.and_then(wobble));
        all.extend(self.few_features());
        let reported = self.poses.map(|report| report.findings.as_slice()).unwrap_or_default();
        all.extend(reported.iter().filter(|warning| is_new(warning)).map(of_report));
        all
    }

    fn no_model(&self) -> Option<ReconstructionFinding> {
        if self.views.iter().any(|view| view.registered) {
            return None;
        }
        let features = self.usual_features();
        let detail = format!(
            "COLMAP found no two views that it could begin with (views of this scan have {features} features, usually): \
             look at the images; take steps of at most 20 degrees; give the specimen more light or texture"
        );
        Some(finding("no_model", detail, Vec::new()))
    }

    fn several_parts(&self) -> Option<ReconstructionFinding> {
        let [first, others @ ..] = self.parts else { return None };
        if others.is_empty() {
            return None;
        }
        let sizes: Vec<String> = others.iter().map(u64::to_string).collect();
        let detail = format!(
            "the views fall into parts that do not connect: one of {first} views, which is kept, and others of {} views; \
             take more views where they part, or leave out views of another specimen",
            sizes.join(" and ")
        );
        Some(finding("several_parts", detail, self.names(|view| !view.registered)))
    }

    /// A view that did not register, and its likely cause.
    fn not_registered(&self, view: &ReconstructedView) -> ReconstructionFinding {
        let asked = self.request.views.iter().find(|asked| asked.name == view.name);
        let remarks = asked.map(|asked| asked.remarks.as_slice()).unwrap_or_default();
        let usual = self.usual_features();
        let cause = match view.features {
            Some(found) if found < FEW_FEATURES.min(usual / 4) => {
                format!("it has only {found} features, the others have {usual}")
            }
            _ if !remarks.is_empty() => "its stack differs from its neighbours".to_owned(),
            Some(found) => format!(
                "it has {found} features, about as many as the others, and they match no other view: it may show another \
                 specimen, or the specimen in another position, or its neighbours are missing"
            ),
            None => "COLMAP did not say how many features it has".to_owned(),
        };
        let remarks: String = remarks.iter().map(|remark| format!("; {remark}")).collect();
        let detail = format!("the view {} did not register: {cause}{remarks}", view.name);
        finding("not_registered", detail, vec![view.name.clone()])
    }

    fn few_features(&self) -> Option<ReconstructionFinding> {
        let few = self.names(|view| view.registered && view.features.is_some_and(|found| found < FEW_FEATURES));
        let usual = self.usual_features();
        if usual >= FEW_FEATURES || few.is_empty() {
            return None;
        }
        let detail = format!(
            "the views have few features ({usual}, usually): fuse larger images (without a crop to the object, at the full \
             size of the slices), light the specimen from the side, or choose max_error_px=4 to keep more matches"
        );
        Some(finding("too_few_features", detail, few))
    }

    /// The median number of features.
    fn usual_features(&self) -> u32 {
        let mut all: Vec<u32> = self.views.iter().filter_map(|view| view.features).collect();
        all.sort_unstable();
        all.get(all.len() / 2).copied().unwrap_or(0)
    }

    fn names(&self, which: impl Fn(&ReconstructedView) -> bool) -> Vec<String> {
        self.views.iter().filter(|view| which(view)).map(|view| view.name.clone()).collect()
    }
}

fn finding(code: &str, detail: String, views: Vec<String>) -> ReconstructionFinding {
    ReconstructionFinding { code: code.to_owned(), detail, views }
}

fn odd_step(step: OddStep) -> ReconstructionFinding {
    let OddStep { before, after, by_deg, by_share, commanded_deg, is_slip } = step;
    let (code, detail) = if is_slip {
        let detail = format!(
            "between {before} and {after} the turntable did not turn by {commanded_deg:.3} degrees as commanded: the step \
             differs from the others by {by_deg:.2} degrees, about the axis of the table. It slipped or missed steps; \
             check its belt and its load, or the angles that were sent"
        );
        ("turntable_slipped", detail)
    } else {
        let detail = format!(
            "between {before} and {after} the specimen moved on the table: the step differs from the others by {by_deg:.2} \
             degrees and {:.0} % of its length, and not as by a turn of the table. From {after} on, the views show it in another position; fix \
             the specimen, and take the scan again from there",
            100.0 * by_share
        );
        ("specimen_moved", detail)
    };
    finding(code, detail, vec![before, after])
}

/// A tilt that rises and falls once in a turn: least squares of `a cos pan + b sin pan`.
fn wobble(report: &PoseReport) -> Option<ReconstructionFinding> {
    let tilts: Vec<(f64, f64)> = report
        .views
        .iter()
        .filter(|view| !view.is_outlier)
        .filter_map(|view| Some((view.commanded_pan_deg?.to_radians(), view.tilt_residual_deg?)))
        .collect();
    if tilts.len() < WOBBLE_VIEWS {
        return None;
    }
    let sum = |of: fn(f64, f64) -> f64| tilts.iter().map(|(pan, tilt)| of(*pan, *tilt)).sum::<f64>();
    let [cc, ss, cs] =
        [sum(|pan, _| pan.cos() * pan.cos()), sum(|pan, _| pan.sin() * pan.sin()), sum(|pan, _| pan.cos() * pan.sin())];
    let [c, s, all] =
        [sum(|pan, tilt| tilt * pan.cos()), sum(|pan, tilt| tilt * pan.sin()), sum(|_, tilt| tilt * tilt)];
    let determinant = cc * ss - cs * cs;
    // a small part of the circle does not tell a wobble from a trend
    if determinant < 0.05 * (cc + ss).powi(2) {
        return None;
    }
    let (a, b) = ((c * ss - s * cs) / determinant, (s * cc - c * cs) / determinant);
    let amplitude = a.hypot(b);
    if amplitude < WOBBLE_DEG || a * c + b * s < WOBBLE_SHARE * all {
        return None;
    }
    let highest = b.atan2(a).to_degrees().rem_euclid(360.0);
    let detail = format!(
        "the tilt rises and falls by {amplitude:.2} degrees once in a turn, highest at a pan of {highest:.0} degrees: the \
         turntable wobbles or is not level; level it, and check that the specimen stands firmly"
    );
    Some(finding("turntable_wobbles", detail, Vec::new()))
}

/// Findings of the report on poses that the others do not contain.
fn is_new(warning: &Warning) -> bool {
    ![WarningCode::NotRegistered, WarningCode::NoAngles].contains(&warning.code)
}

fn of_report(warning: &Warning) -> ReconstructionFinding {
    finding(warning.code.as_str(), warning.detail.clone(), Vec::new())
}
